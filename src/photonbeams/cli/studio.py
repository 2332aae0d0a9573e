"""`photonbeams studio`: edit a shot in the browser while it renders."""

from __future__ import annotations

import logging
import os
import socket
import sys
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from ..scene.extras import needs
from . import options
from .flags import Device, check_flags, start_device, two_eyes
from .progress import messages

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def studio(
    scene: Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage.")],
    camera: Annotated[str | None, typer.Option("--camera", "-cam", help="Path or name of the camera.")] = None,
    layer: Annotated[
        Path | None,
        typer.Option(
            "--layer",
            help="A .usda layer for edits: read if it exists, written by Save; default: look.usda beside the stage.",
        ),
    ] = None,
    res: options.Resolution = (480, 270),
    stereo: options.TwoEyes = False,
    interaxial: options.Interaxial = None,
    convergence: options.Convergence = None,
    passes: Annotated[int, typer.Option("--passes", min=1, help="Number of passes of the finished picture.")] = 64,
    host: Annotated[
        str, typer.Option("--host", help="Address to listen on; any but the default lets other machines in.")
    ] = ("127.0.0.1"),
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port to listen on; 0: any free one.")] = 0,
    open_browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    overrides: options.Overrides = None,
    session_layer: options.SessionLayers = None,
    device: Annotated[Device, typer.Option(help="Processor to render on.")] = Device.auto,
    threads: options.Threads = None,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Edit a shot in the browser: a live picture, and every control of its lights, media and looks beside it.

    Save writes your edits as a USD layer for `photonbeams render --session-layer`. Ctrl-C ends the studio.

    For example:

    photonbeams studio shot.usda --layer look.usda
    """
    check_flags(res)
    eyes = two_eyes(stereo, interaxial, convergence)
    with messages(quiet, verbose):
        start_device(device, threads)
        with needs("studio", "the studio", "a web server"):
            import uvicorn

            from ..studio.server import Studio
        from ..studio import Session
        from ..studio.session import SessionView

        width, height = res
        view = SessionView(width=width or 480, height=height or 270, passes=passes, stereo=eyes)
        target = layer or scene.with_name("look.usda")
        with Session(
            scene, camera, target, view, overrides=overrides or (), session_layers=session_layer or ()
        ) as session:  # fmt: skip
            served = Studio(session, os.environ.get("PHOTONBEAMS_STUDIO_TOKEN"))
            names = (host, f"[{host}]", "127.0.0.1", "localhost") if host in _LOOPBACK else (host, socket.gethostname())
            if host not in _LOOPBACK:
                logging.getLogger("photonbeams").warning(
                    "the studio listens on %s: anyone who has its address can edit the shot from another machine", host
                )
            config = uvicorn.Config(served.app(names), host=host, port=port, log_level="error", ws_max_size=1 << 17)
            listening = _socket(host, port)
            number = listening.getsockname()[1]
            address = f"http://{host if ':' not in host else f'[{host}]'}:{number}/?token={served.token}"
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
