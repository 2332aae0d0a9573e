"""The render engine: it reads what Blender has evaluated, and shows what the renderer makes of it."""

from __future__ import annotations

import tempfile
import time
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np

from .bundle import NoRendererError, NotYetError
from .drawing import Drawing, upwards
from .process import POOL, Renderer
from .reading.cameras import CAMERA, viewport_area, viewport_prim
from .reading.kept import Kept
from .reading.motion import Shutter, is_blurred, shutter_of, with_samples
from .reading.scene import SceneReader
from .settings import chosen_python
from .viewport import Viewport

ENGINE = "PHOTONBEAMS"
#: The render passes: Blender's name, the channels, the kind, and the layer of photonbeams.
PASSES = (
    ("Combined", "RGBA", "COLOR", "rgba"), ("Depth", "Z", "VALUE", "depth"), ("Beams", "RGB", "COLOR", "beams"),
    ("Surface", "RGB", "COLOR", "surface"), ("Transmittance", "RGB", "COLOR", "transmittance"),
)  # fmt: skip
#: Prefixes of the passes of a light group, and of its layers.
_OF_GROUPS = {"Beams ": "beams_", "Surface ": "surface_"}
_WAIT = 0.05  # seconds between looks at whether Blender wants the render to end
_PATIENCE = 0.8  # seconds until a render that was cancelled is ended by force
_OFTEN = 0.02  # seconds between looks at whether a viewport has a new picture
_FARTHEST = 1e10  # the depth where there is nothing, as in Cycles


class PhotonBeamsEngine(bpy.types.RenderEngine):
    """Photon Beams."""

    bl_idname = ENGINE
    bl_label = "Photon Beams"
    bl_use_preview = False
    bl_use_eevee_viewport = True
    bl_use_shading_nodes_custom = False  # materials are edited as for Cycles
    bl_use_postprocess = True

    _viewport: Viewport | None = None

    def update_render_passes(self, scene: Any = None, renderlayer: Any = None) -> None:
        """Tell Blender which passes there are."""
        for name, channels, kind, _ in PASSES:
            self.register_pass(scene, renderlayer, name, len(channels), channels, kind)
        for group in renderlayer.lightgroups:
            for prefix in _OF_GROUPS:
                self.register_pass(scene, renderlayer, prefix + group.name, 3, "RGB", "COLOR")

    def render(self, depsgraph: Any) -> None:
        """Render the picture of a view layer, or the pictures of two eyes."""
        scene, told = depsgraph.scene, set[str]()

        def tell(text: str) -> None:
            if text not in told:
                told.add(text)
                self._report("WARNING", text)

        camera = self.camera_override or scene.camera
        if camera is None or camera.type != "CAMERA":  # Blender takes any object, and its projection has no check
            found = "the scene has no camera" if camera is None else f"the scene's camera is {camera.name}, no camera"
            self._fail(f"{found}: expected one, such as by Add > Camera")
            return
        try:
            renderer = self._renderer()
            if renderer is None:
                return
            try:
                self.update_stats("", "Reading the scene")
                with tempfile.TemporaryDirectory(prefix="photonbeams") as folder:
                    reader = SceneReader(depsgraph, Kept(folder), tell)
                    shutter = shutter_of(scene, tell)
                    prims, eyes = self._read(reader, camera, depsgraph, shutter, tell)
                    renderer.send("scene", prims=prims, whole=True)
                    if scene.render.film_transparent and scene.world is not None:
                        tell("Transparent film: the sky's light is in the picture, where alpha is 0")
                    frame = {} if shutter is None else {"frame": shutter.frame}
                    for view, eye in eyes.items():
                        if view:
                            self.active_view_set(view)
                        renderer.send("scene", prims=[eye])
                        if not self._rendered(renderer, reader, depsgraph, view, tell, frame):
                            return
            finally:
                POOL.give(renderer)
        except NoRendererError as error:
            self._fail(str(error))

    def _renderer(self) -> Renderer | None:
        """Return a renderer, None if the render was cancelled while it was unpacked."""
        while not self.test_break():
            try:
                return POOL.take(chosen_python())
            except NotYetError as waiting:
                self.update_stats("", str(waiting))
                time.sleep(_WAIT)
        return None

    def _read(
        self, reader: SceneReader, camera: Any, depsgraph: Any, shutter: Shutter | None, tell: Any
    ) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]]]:  # fmt: skip
        """Return the prims of the scene, and those of the camera by view, with time samples of what moves."""
        prims, eyes = reader.prims(), self._eyes(reader, camera, depsgraph)
        if shutter is None:
            return prims, eyes
        moved = dict[float, dict[str, Any]]()
        try:
            for at in shutter.other_times():
                self._go_to(at)
                moved[at] = reader.moved() | (self._eyes(reader, camera, depsgraph) if is_blurred(camera) else {})
        finally:
            self._go_to(shutter.frame)

        def sampled(prim: dict[str, Any], name: str) -> dict[str, Any]:
            others = {at: each[name] for at, each in moved.items() if name in each}
            return with_samples(prim, shutter.frame, others, tell)

        eyes = {view: shutter.of_camera(sampled(eye, view)) for view, eye in eyes.items()}
        return [sampled(each, each["path"]) for each in prims], eyes

    def _go_to(self, frame: float) -> None:
        """Let Blender evaluate the scene at a frame, which need not be whole."""
        whole, part = divmod(frame, 1)
        self.frame_set(int(whole), part)

    def _eyes(self, reader: SceneReader, camera: Any, depsgraph: Any) -> dict[str, dict[str, Any]]:
        """Return the prims of the camera by view."""
        found, size = {}, (self.resolution_x, self.resolution_y)
        evaluated = camera.evaluated_get(depsgraph)
        for view in _views(depsgraph.scene):
            if view:
                self.active_view_set(view)
            shift = self.camera_shift_x(evaluated) - evaluated.data.shift_x  # of one of two eyes
            found[view] = reader.camera(camera, self.camera_model_matrix(evaluated), size, shift)
        return found

    def _rendered(
        self, renderer: Renderer, reader: SceneReader, depsgraph: Any, view: str, tell: Any, frame: dict[str, float]
    ) -> bool:  # fmt: skip
        """Render a view; return whether it is finished."""
        scene, whole = depsgraph.scene, (self.resolution_x, self.resolution_y)
        x0, y0, x1, y1 = border(scene.render, whole)
        renderer.rendered += 1
        number = renderer.rendered
        renderer.send(
            "render", number=number, camera=CAMERA, width=whole[0], height=whole[1],
            # A little inside of the first pixel, which is found by rounding down.
            crop=[(x0 + 1e-4) / whole[0], (y0 + 1e-4) / whole[1], x1 / whole[0], y1 / whole[1]],
            pixel_aspect=scene.render.pixel_aspect_x / scene.render.pixel_aspect_y,
            settings=scene.photonbeams.arguments(), **frame,
        )  # fmt: skip
        while True:
            if self.test_break():
                return self._cancelled(renderer, number)
            message = renderer.receive(_WAIT)
            if message is None or message.get("number", number) != number:
                continue
            match message["is"]:
                case "warning":
                    tell(message["text"])
                case "progress":
                    self._tell_progress(message)
                case "picture":
                    self._show(message["layers"], depsgraph, view, reader.groups)
                case "end":
                    if message["problem"]:
                        self._fail(message["problem"])
                    return not message["problem"]

    def view_update(self, context: Any, depsgraph: Any) -> None:
        """Note what has changed since the viewport was drawn last."""
        if self._viewport is None:
            self._viewport, self._drawing = Viewport(), Drawing()
            weakref.finalize(self, self._viewport.close)
            bpy.app.timers.register(_follower(self, self._viewport), first_interval=_OFTEN)
        self._viewport.change(depsgraph.updates)

    def view_draw(self, context: Any, depsgraph: Any) -> None:
        """Draw the last picture, and ask for one of what is seen now."""
        if self._viewport is None:
            self.view_update(context, depsgraph)
        assert self._viewport is not None
        scene, region = depsgraph.scene, context.region
        coarse = _coarseness(scene.render.preview_pixel_size)
        seen = context.region_data, context.space_data
        view = {
            "width": max(1, region.width // coarse), "height": max(1, region.height // coarse),
            "area": viewport_area(*seen, scene), **scene.photonbeams.viewed(),
        }  # fmt: skip
        self._viewport.show(depsgraph, chosen_python(), viewport_prim(*seen, depsgraph), view)
        for text in self._viewport.warnings():
            self._report("WARNING", text)
        self.update_stats("", self._viewport.text)
        if self._viewport.picture is not None:
            self._drawing.draw(self._viewport.picture, (region.width, region.height), scene.render.film_transparent)

    def _report(self, kind: str, text: str) -> None:
        """Report a sentence, in which names may have any character: without those that a terminal would obey."""
        self.report({kind}, "".join(each if each.isprintable() else repr(each)[1:-1] for each in text))

    def _fail(self, text: str) -> None:
        """Say why there is no picture: in the status bar or to a script, and in the picture's own window."""
        self._report("ERROR", text)
        if not bpy.app.background:  # there Blender would report it again
            self.error_set(text)

    def _tell_progress(self, message: Any) -> None:
        done, planned = message["done"], max(message["planned"], 1)
        error = "" if message["error"] is None else f" | error {message['error']:.1%}"
        self.update_progress(done / planned)
        self.update_stats("", f"Pass {done} of {planned}{error}")

    def _cancelled(self, renderer: Renderer, number: int) -> bool:
        """End a render that is not wanted; return False."""
        renderer.send("cancel", number=number)
        until = time.monotonic() + _PATIENCE
        while time.monotonic() < until:
            message = renderer.receive(_WAIT)
            if message is not None and message["is"] == "end" and message["number"] == number:
                return False
        renderer.close()
        return False

    def _show(self, layers: dict[str, Any], depsgraph: Any, view: str, groups: dict[str, str]) -> None:
        """Put layers into Blender's render result; `groups` are the names of light groups here, by Blender's."""
        transparent = depsgraph.scene.render.film_transparent
        height, width = layers["rgba"].shape[:2]
        result = self.begin_result(0, 0, width, height, layer=depsgraph.view_layer.name, view=view)
        try:
            found = {name: layer for name, *_, layer in PASSES}
            for prefix, layer in _OF_GROUPS.items():
                found |= {prefix + name: layer + token for name, token in groups.items()}
            for each in result.layers[0].passes:
                name = found.get(each.name, "")
                if name in layers:
                    each.rect.foreach_set(_pixels(layers[name], each.channels, name, transparent).ravel())
        finally:
            self.end_result(result)


def _pixels(layer: Any, channels: int, name: str, transparent: bool) -> Any:
    """Return a layer of some name as Blender has it; see `upwards`."""
    pixels = upwards(layer, channels, opaque=name == "rgba" and not transparent)
    return np.minimum(pixels, _FARTHEST) if name == "depth" else pixels


def border(render: Any, whole: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return the pixels that are rendered, x0, y0, x1, y1 from the top left, rounded as Blender does."""
    width, height = whole
    if not render.use_border:
        return 0, 0, width, height

    def rounded(edge: float, size: int) -> int:
        return int(np.float32(edge) * np.float32(size))

    x0, x1 = rounded(render.border_min_x, width), rounded(render.border_max_x, width)
    return x0, height - rounded(render.border_max_y, height), x1, height - rounded(render.border_min_y, height)


def _coarseness(chosen: str) -> int:
    """Return the pixels of the screen in a rendered one, each way."""
    return int(bpy.context.preferences.system.pixel_size) if chosen == "AUTO" else int(chosen)


def _follower(engine: PhotonBeamsEngine, viewport: Viewport) -> Callable[[], float | None]:
    """Return a timer that has a viewport drawn when there is something new, as long as its engine exists."""
    known = weakref.ref(engine)

    def follow() -> float | None:
        if (engine := known()) is None:
            return None
        try:
            if viewport.poll():
                engine.tag_redraw()
        except ReferenceError:  # Blender has freed it
            return None
        return _OFTEN

    return follow


def _views(scene: Any) -> Iterator[str]:
    """Yield the names of the views that are rendered; "" without multi-view."""
    if not scene.render.use_multiview:
        yield ""
        return
    yield from (each.name for each in scene.render.views if each.use)
