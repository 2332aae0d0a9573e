"""A studio's server in a thread, and a page's side of the connection."""

import json
import threading
import time
from contextlib import closing
from http.client import HTTPConnection
from io import BytesIO

import numpy as np
import uvicorn
from PIL import Image
from websockets.sync.client import connect

from photonbeams.studio.server import Studio
from photonbeams.studio.session import Session
from tests.studio.sessions import VIEW

TOKEN = "a-token-of-tests"


class Served:
    """A server in a thread of its own."""

    def __init__(self, path, url="", **given):
        self.session = Session(path, **{"view": VIEW, **given})
        self.studio = Studio(self.session, TOKEN)
        config = uvicorn.Config(
            self.studio.app(url=url), host="127.0.0.1", port=0, log_level="error", ws_max_size=1 << 17
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, daemon=True)
        self._thread.start()
        while not self._server.started:
            time.sleep(0.01)
        self.port = self._server.servers[0].sockets[0].getsockname()[1]

    def page(self, **given):
        return Page(self.port, **given)

    def wait_until_left(self, limit=60):
        """Wait until the server has done what the last pages asked for, and all of them are gone."""
        end = time.monotonic() + limit
        while self._server.server_state.connections:
            assert time.monotonic() < end
            time.sleep(0.01)

    def close(self):
        self._server.should_exit = True
        self._thread.join()
        self.session.close()


class Page:
    """A page's side of the connection: it reads messages until the wanted one arrives."""

    def __init__(self, port, token=TOKEN, **headers):
        address = f"ws://127.0.0.1:{port}/session?token={token}"
        self._connection = connect(address, additional_headers=headers, max_size=None, proxy=None)

    def __enter__(self):
        self._socket = self._connection.__enter__()
        return self

    def __exit__(self, *given):
        self._connection.__exit__(*given)

    def send(self, kind, **content):
        self._socket.send(json.dumps({"type": kind, **content}))

    def send_raw(self, data):
        self._socket.send(data)

    def wait(self, wanted, limit=60):
        """Return the first message that `wanted` accepts: a dict, or a picture's header and its pixels."""
        end = time.monotonic() + limit
        while True:
            message = self._socket.recv(timeout=max(end - time.monotonic(), 0.01))
            if isinstance(message, bytes):
                length = int.from_bytes(message[:4], "little")
                header = json.loads(message[4 : 4 + length])
                if wanted(header):
                    return header, np.asarray(Image.open(BytesIO(message[4 + length :])).convert("RGB"))
            elif wanted(found := json.loads(message)):
                return found

    def told(self, kind):
        return self.wait(lambda each: each.get("type") == kind)

    def finished(self, version=0):
        return self.wait(
            lambda each: "mime" in each and each["mime"] == "image/png" and each["version"] >= version
        )  # fmt: skip


def asked(served, path, **headers):
    """Return status, headers and content of the answer to a request."""
    with closing(HTTPConnection("127.0.0.1", served.port, timeout=20)) as connection:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
