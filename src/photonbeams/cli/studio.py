"""`photonbeams studio`: edit a shot in the browser while it renders."""

from __future__ import annotations

import logging
import os
import socket
import sys
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import urlsplit

import typer

from ..scene.extras import needs
from .flags import Camera, DeviceFlags, EyeFlags, LayerFlags, MessageFlags, Resolution, Stage
from .progress import messages

if TYPE_CHECKING:
    from ..studio.server import Studio

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def studio(
    scene: Stage,
    eyes: EyeFlags,
    layers: LayerFlags,
    device: DeviceFlags,
    shown: MessageFlags,
    camera: Camera = None,
    layer: Annotated[
        Path | None,
        typer.Option(
            "--layer",
            help="A .usda layer for edits: read if it exists, written by Save; default: look.usda beside the stage.",
        ),
    ] = None,
    looks: Annotated[
        Path | None,
        typer.Option("--looks", help="Folder of the look library that shots share; default: looks beside the stage."),
    ] = None,
    res: Resolution = (480, 270),
    passes: Annotated[int, typer.Option("--passes", min=1, help="Number of passes of the finished picture.")] = 64,
    host: Annotated[
        str, typer.Option("--host", help="Address to listen on; any but the default lets other machines in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port to listen on; 0: any free one.")] = 0,
    url: Annotated[
        str, typer.Option("--url", help="The page's address behind a proxy, as browsers see it: https://host/path/.")
    ] = "",
    open_browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """Edit a shot in the browser: a live picture, and every control of its lights, media and looks beside it.

    Save writes your edits as a USD layer for `photonbeams render --session-layer`. Ctrl-C ends the studio.

    For example:

    photonbeams studio shot.usda --layer look.usda
    """
    with messages(shown):
        device.start()
        with needs("studio", "the studio", "a web server"):
            from ..studio.server import Studio
        from ..studio import Session
        from ..studio.session import SessionView

        view = SessionView(width=res[0] or 480, height=res[1] or 270, passes=passes, stereo=eyes.eyes())
        target = layer or scene.with_name("look.usda")
        with Session(
            scene, camera, target, view, overrides=layers.overrides or (), session_layers=layers.session_layer or (),
            looks=looks,
        ) as session:  # fmt: skip
            _serve(Studio(session, os.environ.get("PHOTONBEAMS_STUDIO_TOKEN")), host, port, url, open_browser)


def _serve(studio: Studio, host: str, port: int, url: str, open_browser: bool) -> None:
    """Serve the page until Ctrl-C, and print its address."""
    import uvicorn

    if url and (urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).netloc):
        raise typer.BadParameter(f"{url!r:.80} is no address: expected https://host/path/", param_hint="--url")
    names = (host, f"[{host}]", "127.0.0.1", "localhost") if host in _LOOPBACK else (host, socket.gethostname())
    if host not in _LOOPBACK:
        logging.getLogger("photonbeams").warning(
            "the studio listens on %s: anyone who has its address can edit the shot from another machine", host
        )
    config = uvicorn.Config(studio.app(names, url), host=host, port=port, log_level="error", ws_max_size=1 << 17)
    listening = _socket(host, port)
    number = listening.getsockname()[1]
    root = f"{url.rstrip('/')}/" if url else f"http://{host if ':' not in host else f'[{host}]'}:{number}/"
    address = f"{root}?token={studio.token}"
    print(address, flush=True)
    if open_browser and (os.environ.get("DISPLAY") or sys.platform in ("darwin", "win32")):
        webbrowser.open(address)
    with suppress(KeyboardInterrupt):  # the usual way to end a studio
        uvicorn.Server(config).run(sockets=[listening])


def _socket(host: str, port: int) -> socket.socket:
    """Return a listening socket; its port is known before the server runs."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    result = socket.socket(family, socket.SOCK_STREAM)
    result.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        result.bind((host, port))
        result.listen(128)  # a browser may connect before the server runs
    except OSError as error:
        raise typer.BadParameter(f"{host}:{port} cannot be used: {error.strerror}", param_hint="--port") from None
    return result
