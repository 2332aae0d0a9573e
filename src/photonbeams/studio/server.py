"""The studio's server: the page, and one WebSocket for each browser that watches the session.

It listens on the loopback device. A token in the address lets a page in. Host, origin and token are checked on each
request, so that others who know only the port, such as another page in the same browser, do not get in.
"""

from __future__ import annotations

import asyncio
import os
import secrets
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import msgspec
import numpy as np
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from ..images.display import OWN, view_transforms
from ..scene import SceneError, choice, number
from ..usd.authoring.presets import PRESETS
from ..usd.cameras.stereo import Stereo, usual_interaxial
from . import controls, protocol
from .edits import ChangedError, IfChanged
from .encoding import ANAGLYPH, SHOWN, encoded, thumbnail_of
from .final import Estimates, FinalRender, Wanted
from .guard import HEADERS, Guard
from .session import Picture, Problem, Session
from .watcher import Watcher

PAGE = Path(__file__).parent / "page"

_LOCAL = ("127.0.0.1", "localhost", "[::1]")
_MALFORMED = 4400  # WebSocket close code, from the range for applications
_TYPES = {".js": "text/javascript", ".css": "text/css"}  # as the system may map suffixes wrongly


# What each page chooses for itself, while the view is everybody's.
_OWN_CHOICES = ("layer", "other", "eye", "exposure", "display")


class Studio:
    """A session and the pages that watch it; the `token` lets a page in."""

    def __init__(self, session: Session, token: str | None = None) -> None:
        self.session, self.token = session, token or secrets.token_urlsafe(24)
        self._watchers: set[Watcher] = set()
        self._last: Picture | None = None
        self._problem: Problem | None = None
        self._shape: list[Any] = []
        self._known: dict[str, tuple[Any, bool]] = {}
        # One thread runs everything that waits for the session, so that edits keep their order. Pictures have another,
        # and so have thumbnails, whose kernels are compiled on first use.
        self._commands, self._encoders, self._painters = self._threads = [ThreadPoolExecutor(1) for _ in range(3)]
        self._final = FinalRender()
        self._estimates = Estimates(self._final.folder, session.resting)
        self._loop: asyncio.AbstractEventLoop | None = None

    def app(self, hosts: tuple[str, ...] = _LOCAL, url: str = "") -> Starlette:
        """Return the server's application for these host names; `url` is its address for browsers behind a proxy."""
        return Starlette(
            routes=[
                Route("/", self._page), Route("/assets/{name}", self._asset), Route("/result/{name}", self._result),
                Route("/presets/{name}", self._thumbnail), WebSocketRoute("/session", self._watch),
            ],
            middleware=[Middleware(Guard, token=self.token, hosts=hosts, url=url)],
            lifespan=self._running,
        )  # fmt: skip

    @asynccontextmanager
    async def _running(self, _app: Starlette) -> AsyncIterator[None]:
        self._loop = asyncio.get_running_loop()
        end = self.session.listen(self._told)
        await self._command(self.session.show)
        try:
            yield
        finally:
            end()
            self._final.close()
            for each in self._threads:
                each.shutdown(cancel_futures=True)

    async def _page(self, _request: Request) -> Response:
        index = PAGE / "index.html"
        if not index.exists():
            return PlainTextResponse("the page is not built: run `npm ci && npm run build` in page/\n", 500, HEADERS)
        return FileResponse(index, headers=HEADERS)

    async def _asset(self, request: Request) -> Response:
        return _file_of(PAGE / "assets", request)

    async def _thumbnail(self, request: Request) -> Response:
        """Return the thumbnail of a preset; it is made on the first request."""
        name, looks = request.path_params["name"].removesuffix(".png"), self.session.looks
        work = asyncio.get_running_loop().run_in_executor(self._painters, lambda: thumbnail_of(looks.preset(name)))
        try:
            headers = {**HEADERS, "cache-control": "private, max-age=86400"}  # for one token
            return Response(await work, headers=headers, media_type="image/png")
        except SceneError as error:
            return PlainTextResponse(f"{error}\n", 404, HEADERS)

    def _told(self, what: Picture | Problem) -> None:
        """Take what the session tells; this runs in the session's thread."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            with suppress(RuntimeError):  # the loop may end meanwhile
                loop.call_soon_threadsafe(self._arrived, what)

    def _arrived(self, what: Picture | Problem) -> None:
        if isinstance(what, Problem):
            self._problem = what
        else:
            fresh = self._last is None or self._last.layers.keys() != what.layers.keys()
            self._last, self._problem = what, None
            if fresh:
                self._later(self._tell_scene())
        self._tell_all(self._state())
        for each in self._watchers if self._problem is None else ():
            each.show(self._last)

    def _later(self, work: Any) -> asyncio.Future[None]:
        task = asyncio.ensure_future(work)
        task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return task

    def _state(self) -> protocol.StateMessage:
        last, problem = self._last, self._problem
        done = 0 if last is None or last.is_first else last.passes
        planned = self.session.view.passes
        seconds = 0.0 if last is None else sum(last.statistics.seconds.values())
        told = None
        if problem is not None:  # without the file's name, which the page shows anyway
            text = problem.text[max(problem.text.find(problem.path or ""), 0) :]
            told = protocol.ProblemText(text, problem.path, problem.column)
        version = self.session.version
        busy = problem is None and (last is None or last.version != version or done < planned)
        return protocol.StateMessage(version, done, planned, round(seconds, 3), busy, told)

    async def _command(self, work: Callable[..., Any], *given: Any, **named: Any) -> Any:
        """Run a method of the session, which may wait until the stage is read, and return its result."""
        return await asyncio.get_running_loop().run_in_executor(self._commands, lambda: work(*given, **named))

    async def _tell_scene(self, only: Watcher | None = None) -> None:
        message = await self._command(self._scene)
        for each in [only] if only is not None else self._watchers:
            each.tell(message)

    def _scene(self) -> protocol.SceneMessage:
        session, last = self.session, self._last
        known = (*PRESETS, *session.looks.looks())
        presets = [protocol.PresetItem(each.name, each.label, each.factor) for each in known]
        stereo, pose, focal = session.view.stereo, None, 1.0
        with suppress(SceneError):  # edits may have broken the camera; the state says so
            camera = session.camera()
            pose = np.asarray(camera.to_world).ravel().tolist()
            focal = 1.0 if camera.orthographic else camera.focal_length / camera.horizontal_aperture
        return protocol.SceneMessage(
            name=session.name, cameras=session.cameras(), frames=session.frames(), fps=session.rate(),
            layers=["rgba"] if last is None else list(last.layers), displays=view_transforms(),
            controls=self._read_controls(), pose=pose, up=session.up(), focal=focal,
            stereo=None if stereo is None else (stereo.interaxial, stereo.convergence), pair=session.has_pair(),
            interaxial=usual_interaxial(session.shot.stage), bounces=session.bounces(), presets=presets,
        )  # fmt: skip

    def _read_controls(self) -> list[protocol.ControlGroup]:
        """Return the controls as the stage has them now."""
        groups = controls.described(self.session.controls())
        self._shape, self._known = controls.shape(groups), controls.states(groups)
        return groups

    async def _watch(self, socket: WebSocket) -> None:
        await socket.accept()
        watcher = Watcher(socket)
        self._watchers.add(watcher)
        sender = asyncio.ensure_future(self._send(watcher))
        try:
            await self._tell_scene(watcher)
            watcher.tell(self._values({}))
            watcher.tell(self._state())
            watcher.show(self._last)
            while True:
                message = await socket.receive()
                if message["type"] == "websocket.disconnect":
                    break
                await self._take(watcher, message)
        except WebSocketDisconnect:
            pass
        except protocol.Malformed as error:
            with suppress(RuntimeError, WebSocketDisconnect):
                await socket.send_text(protocol.encoded(protocol.Refused(str(error))))
                await socket.close(_MALFORMED, str(error)[:120])
        finally:
            self._watchers.discard(watcher)
            watcher.end_estimate()
            sender.cancel()

    async def _take(self, watcher: Watcher, message: Any) -> None:
        if watcher.is_too_fast():
            raise protocol.Malformed(f"there are more than {protocol.PER_SECOND} messages in a second: expected fewer")
        text = message.get("text")
        if text is None:
            raise protocol.Malformed("the message is not text: expected JSON")
        try:
            await self._do(watcher, protocol.decoded(text))
        except (SceneError, OSError) as error:
            watcher.tell(protocol.Refused(str(error)[:300]))

    async def _do(self, watcher: Watcher, asked: protocol.Messages) -> None:
        """Do what a page asks for."""
        session = self.session
        match asked:
            case protocol.Set(values=values, step=step):
                await self._command(session.edit, values, step)
                await self._tell_edited(values)
            case protocol.Apply(preset=preset, path=path):
                look = await self._command(session.apply, preset, path)
                await self._tell_edited(None)
                watcher.tell(protocol.Applied(path, look))
            case protocol.Keep(path=path):
                watcher.tell(protocol.Kept(path, await self._command(session.keep_look, path)))
                await self._tell_scene()
            case protocol.Undo() | protocol.Redo() | protocol.Revert() | protocol.Discard():
                await self._command(getattr(session, type(asked).__name__.lower()))
                await self._tell_edited(None)
            case protocol.Save(changed=changed):
                await self._save(watcher, changed)
            case protocol.Show():
                await self._show(watcher, asked)
            case protocol.Inspect(at=at):
                layers = _pixel(at, self._last)
                depth = layers.get("depth", [None])[0]
                beams, ray = await self._command(session.inspect, at, depth)
                watcher.tell(protocol.PixelMessage(at, layers, beams, ray))
            case protocol.Render(passes=passes, frames=frames, size=size, denoise=denoise, file=file):
                wanted = await self._command(session.wanted, passes, frames, size, denoise, file)
                self._later(self._render(wanted))
            case protocol.Estimate():
                watcher.end_estimate()
                watcher.estimate = self._later(self._estimate(watcher, asked))
            case protocol.Cancel(estimate=True):
                watcher.end_estimate()
            case protocol.Cancel():
                self._final.cancel()

    async def _save(self, watcher: Watcher, changed: IfChanged) -> None:
        """Save the edits; if another program has changed their file, ask the page, or tell it of the copy."""
        before = self.session.edits.path
        name = "" if before is None else before.name
        try:
            written = await self._command(self.session.save, changed)
        except ChangedError:
            watcher.tell(protocol.Changed(name, None))
            return
        if written != before:
            watcher.tell(protocol.Changed(name, written.name))
        await self._tell_edited(None if changed == "merge" else {})

    async def _show(self, watcher: Watcher, asked: protocol.Show) -> None:
        changes = {name: value for name, value in msgspec.structs.asdict(asked).items() if value is not msgspec.UNSET}
        choices = {name: changes.pop(name) for name in _OWN_CHOICES if name in changes}
        choice(choices.get("display", OWN), "the view transform", view_transforms())
        choice(choices.get("eye", ANAGLYPH), "the eye", SHOWN)
        number(choices.get("exposure", 0.0), "the exposure", -64, 64)
        for name, value in choices.items():
            setattr(watcher, name, value)
        if choices:
            watcher.show(self._last)
        if "size" in changes:
            changes["width"], changes["height"] = changes.pop("size")
        if changes.get("stereo") is not None:
            changes["stereo"] = Stereo(*changes["stereo"])
        if changes:
            before = self.session.view
            await self._command(self.session.show, **changes)
            now = self.session.view
            if (now.camera, now.frame) != (before.camera, before.frame):  # then pose and values are others
                self._later(self._tell_scene())
            self._tell_all(self._state())

    async def _render(self, wanted: Wanted) -> None:
        async def told(done: int, file: Path | None, problem: str | None) -> None:
            own = wanted.file is None
            link = f"result/{quote(file.name)}?token={self.token}" if file is not None and own else None
            written = str(file) if file is not None and not own else None
            self._tell_all(protocol.RenderMessage(done, 100, link, written, problem))

        try:
            await self._final.run(wanted, told)
        except (SceneError, OSError) as error:
            self._tell_all(protocol.Refused(str(error)[:300]))

    async def _estimate(self, watcher: Watcher, asked: protocol.Estimate) -> None:
        """Tell a page what a final render costs, or why that is not known."""
        try:
            wanted = await self._command(self.session.wanted, asked.passes, asked.frames, asked.size, asked.denoise)
            answer = protocol.EstimateMessage(asked.number, *await self._estimates.of(wanted), None)
        except (SceneError, OSError) as error:
            answer = protocol.EstimateMessage(asked.number, None, None, str(error)[:300])
        watcher.tell(answer)

    async def _result(self, request: Request) -> Response:
        return _file_of(self._final.folder, request, download=True)

    async def _tell_edited(self, edited: dict[str, Any] | None) -> None:
        """Tell all pages about an edit: see `_values`; if there are other controls now, tell them the scene first."""
        before = self._shape
        message = await self._command(self._values, edited)
        if self._shape != before:
            await self._tell_scene()
        self._tell_all(message)

    def _values(self, edited: dict[str, Any] | None) -> protocol.ValuesMessage:
        """Return the message about values that changed: the edited ones, or with None any.

        If an edit leaves a value to the stage, or changes the look of a light, the controls are read from the stage to
        know the new values.
        """
        edits, before = self.session.edits, self._known
        if edited is None or any(value is None or path.endswith(":look") for path, value in edited.items()):
            self._read_controls()
        else:
            self._known = before | {path: (value, True) for path, value in edited.items()}
        changed = {path: state for path, state in self._known.items() if before.get(path) != state}
        return protocol.ValuesMessage(
            values={path: value for path, (value, _) in changed.items()},
            authored={path: is_authored for path, (_, is_authored) in changed.items()},
            canUndo=edits.can_undo, canRedo=edits.can_redo,
            saved=edits.is_saved, restored=edits.restored and not edits.is_saved,
        )  # fmt: skip

    def _tell_all(self, message: protocol.Answers) -> None:
        for each in self._watchers:
            each.tell(message)

    async def _send(self, watcher: Watcher) -> None:
        """Send a page its texts and only the newest of its pictures."""
        loop = asyncio.get_running_loop()
        while True:
            await watcher.news.wait()
            watcher.news.clear()
            while watcher.texts:
                await watcher.socket.send_text(watcher.texts.popleft())
            picture, watcher.shown = watcher.shown, None
            if picture is not None:
                for layer in (watcher.layer,) if watcher.other is None else (watcher.other, watcher.layer):
                    data = await loop.run_in_executor(self._encoders, _encoded, picture, watcher, layer)
                    await watcher.socket.send_bytes(data)


def _encoded(picture: Picture, watcher: Watcher, layer: str) -> bytes:
    """Return a layer of a picture as a page shows it, after its header."""
    header, data = encoded(picture, layer, watcher.exposure, watcher.display, watcher.eye)
    header.compared = layer == watcher.other and layer != watcher.layer
    return protocol.framed(header, data)


def _file_of(folder: Path, request: Request, download: bool = False) -> Response:
    """Return the file in a folder that a request names, for the page or as a download."""
    file = folder / request.path_params["name"]
    if file.parent != folder or not os.path.isfile(file):  # `Path.is_file` raises an error for names that are too long
        return PlainTextResponse("there is no such file\n", 404, HEADERS)
    kind = None if download else _TYPES.get(file.suffix)
    return FileResponse(file, headers=HEADERS, media_type=kind, filename=file.name if download else None)


def _pixel(at: tuple[float, float], picture: Picture | None) -> dict[str, list[float]]:
    """Return the values of all layers in the pixel at a place, in fractions of the picture from the top left."""
    if picture is None or not all(0 <= each <= 1 for each in at):
        return {}
    found = {}
    for name, pixels in picture.layers.items():
        height, width = pixels.shape[:2]
        column, row = min(int(at[0] * width), width - 1), min(int(at[1] * height), height - 1)
        found[name] = [float(each) for each in np.ravel(pixels[row, column])]
    return found
