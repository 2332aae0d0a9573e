"""A reverse proxy for tests: it forwards connections to another port, as nginx or `ssh -L` does."""

import re
import socket
import threading
from contextlib import suppress

PREFIX = "/user/me/proxy"


class Proxy:
    """Forwards requests to `port`; below `PREFIX` it does so without the prefix, and under the host's own name."""

    def __init__(self):
        self.port = 0  # of the server behind it
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self):
        self._listening.close()

    def _serve(self):
        with suppress(OSError):  # once it is closed
            while True:
                connection, _ = self._listening.accept()
                threading.Thread(target=self._forward, args=(connection,), daemon=True).start()

    def _forward(self, client):
        head = b""
        with client, suppress(OSError):  # browsers open connections in advance, and end them unused
            while b"\r\n\r\n" not in head:
                more = client.recv(4096)
                if not more:
                    return
                head += more
            with socket.create_connection(("127.0.0.1", self.port)) as server:
                server.sendall(self._rewritten(head))
                back = threading.Thread(target=_pump, args=(server, client), daemon=True)
                back.start()
                _pump(client, server)
                back.join()

    def _rewritten(self, head):
        """Return the head of a request as the server gets it; it is the only one of its connection."""
        if b"upgrade: websocket" not in head.lower():
            head = re.sub(rb"(?i)connection: [^\r]*", b"Connection: close", head)
        if f" {PREFIX}/".encode() in head:
            head = head.replace(f" {PREFIX}/".encode(), b" /", 1)
            head = re.sub(rb"(?i)host: [^\r]*", f"Host: 127.0.0.1:{self.port}".encode(), head, count=1)
        return head


def _pump(source, target):
    """Send on what arrives, until one side ends."""
    with suppress(OSError):
        while data := source.recv(1 << 16):
            target.sendall(data)
    with suppress(OSError):
        target.shutdown(socket.SHUT_WR)
