"""`photonbeams info`: show what a stage, a picture or a volume file holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from ..runtime.device import check_address_space
from ..runtime.inputs import opened
from ..scene import Array, SceneError
from ..volumes.vdb import VDBGrid, read_grids
from ..volumes.vol import read_vol
from .flags import SessionLayers
from .progress import messages, standard_output

if TYPE_CHECKING:
    from pxr import Usd
    from rich.console import Console
    from rich.table import Table

    from ..scene import Camera, Light, Mesh, Scene

MESHES_SHOWN, CAMERAS_WATCHING = 60, 3
STAGES = (".usd", ".usda", ".usdc", ".usdz")
VOLUMES = (".vdb", ".vol")
VOLUME_COLUMNS = ("grid", "type", "class", "voxels", "box", "from", "voxel size", "range", "dense", "compression")
_NO_NEWS = ("channels", "chunkCount", "lineOrder", "name", "type", "view", "screenWindowCenter", "screenWindowWidth")


def info(
    path: Annotated[Path, typer.Argument(help="A stage, an image, or a volume file.")],
    session_layer: SessionLayers = None,
) -> None:
    """Show what a USD stage, an image or a volume file holds.

    For a stage: cameras, lights, what part of their power gets into fog and is seen, meshes, fog, looks, frames and
    units. For an image: its parts with their views, channels, sizes, ranges and NaNs, and its headers. For a .vdb or
    .vol file: its grids with their types, boxes of active voxels, ranges of values, and the memory of the box.
    """
    console = standard_output()
    if path.suffix.lower() in STAGES:
        check_address_space()
        with messages(quiet=False, verbose=False):
            _show_stage(console, path, session_layer or ())
    elif session_layer:
        raise typer.BadParameter(f"--session-layer is for stages, but {path} is not one: expected {', '.join(STAGES)}")
    elif path.suffix.lower() in VOLUMES:
        console.print(_table(VOLUME_COLUMNS, volume_rows(path)))
    else:
        _show_image(console, path)


# -- images ----------------------------------------------------------------------------------------------------------


def _show_image(console: Console, path: Path) -> None:
    from ..images.files import summaries

    parts = summaries(path)
    stereo = any(part.view for part in parts)
    rows = []
    for part in parts:
        channels = " ".join(part.channels) if max(map(len, part.channels)) > 1 else "".join(part.channels)
        types = ", ".join(dict.fromkeys(part.types))
        names = (part.layer, part.view) if stereo else (part.layer,)
        ranges = ("-" if value is None else f"{value:.5g}" for value in (part.least, part.mean, part.greatest))
        counts = (f"{count:,}" for count in (part.nans, part.infinite))
        rows.append((*names, channels, types, f"{part.width} x {part.height}", *ranges, *counts))
    columns = ("layer", *(["view"] if stereo else []), "channels", "type", "size", "min", "mean", "max")
    console.print(_table((*columns, "NaN", "infinite"), rows, right=5))
    header = _header_rows(path) if path.suffix.lower() == ".exr" else []
    if header:
        console.print()
        console.print(_table(None, header))


def _header_rows(path: Path) -> list[tuple[str, str]]:
    """Return the attributes of each view's first part, without those that describe the layout of the file.

    An attribute that is the same in all views is listed once; others, such as matrices, are listed for each view.
    """
    from ..images.tiles import exr_parts

    headers: dict[str, dict[str, str]] = {}
    for part in exr_parts(path, header_only=True):
        texts = {name: _text(value) for name, value in part.header.items() if name not in _NO_NEWS}
        headers.setdefault(str(part.header.get("view", "")), texts)
    rows: list[tuple[str, str]] = []
    for name in sorted({name for header in headers.values() for name in header}):
        texts = {view: header[name] for view, header in headers.items() if name in header}
        if len(texts) == len(headers) and len(set(texts.values())) == 1:
            rows.append((name, next(iter(texts.values()))))
        else:
            rows += [(f"{name} {view}".rstrip(), text) for view, text in texts.items()]
    return rows


def _text(value: object) -> str:
    """Return a readable text for a header's value: matrices as rows, windows as corners."""
    if isinstance(value, tuple | list):
        return ", ".join(_text(each) for each in value)
    if isinstance(value, np.ndarray) and value.ndim == 1:
        return " ".join(f"{number:g}" for number in value)
    if isinstance(value, np.ndarray):
        return "\n".join(" ".join(f"{number:9.5g}" for number in row) for row in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(getattr(value, "name", value))


# -- stages ----------------------------------------------------------------------------------------------------------


def _show_stage(console: Console, path: Path, layers: Sequence[Path]) -> None:
    from ..usd import stage as stages
    from ..usd.common.warnings import Warnings
    from ..usd.unread import warn_of_unread

    stage = stages.open_stage(path, layers)
    warn_of_unread(stage, Warnings())
    time = stages.default_time(stage)
    scene = stages.read_scene(stage, time)
    console.print(_table(None, _stage_rows(stage, scene)))
    watching = _watching(stage, time)
    sections = [
        ("camera", "lens", "view", "shutter", "focus", "exposure", "position"),
        ("light", "kind", "radiance", "group", "beams", "portal", "look"),
        ("light", "power in fog", *(f"seen by {name}" for name in watching)),
        ("mesh", "points", "triangles", "material"),
        ("drawn beams", "count", "group", "look"),
        ("look", "along", "across", "eye", "angle"),
    ]
    tables: list[list[tuple[str, ...]]] = [
        _camera_rows(stage, time),
        [_light_row(light) for light in scene.lights] + _hidden_rows(stage, time),
        _reach_rows(scene, watching),
        _mesh_rows(scene.meshes),
        [(each.name, f"{len(each.start):,}", each.group, _name(each.look)) for each in scene.drawn],
        list(_look_rows(scene)),
    ]
    for columns, rows in zip(sections, tables, strict=True):
        if rows:
            console.print()
            console.print(_table(columns, rows))


def _hidden_rows(stage: Usd.Stage, time: Usd.TimeCode) -> list[tuple[str, ...]]:
    """Return a row for each light that is hidden when the stage starts: a film may show it later."""
    from ..usd.groups import hidden_lights

    return [(path, "hidden at first", "", "", "", "", "") for path in hidden_lights(stage, time)]


def _stage_rows(stage: Usd.Stage, scene: Scene) -> Iterable[tuple[str, str]]:
    from pxr import UsdGeom

    from ..usd.layers.frames import time_range
    from ..world.media.medium_colors import colors_of_medium

    yield "up axis", str(UsdGeom.GetStageUpAxis(stage))
    yield "unit", f"{UsdGeom.GetStageMetersPerUnit(stage):g} m"
    ends = time_range(stage)
    frames = "no range" if ends is None else f"{ends[0]:g} to {ends[1]:g}"
    yield "frames", f"{frames}, {stage.GetTimeCodesPerSecond():g} a second"
    yield "triangles", f"{sum(len(mesh.faces) for mesh in scene.meshes):,} in {len(scene.meshes):,} meshes"
    lit = "" if scene.bounces else ": surfaces are lit only directly, and a room is dark; light it with --bounces 3"
    yield "bounces", f"{scene.bounces}{lit}"
    grids = [(each, each.grid) for each in scene.media if each.grid is not None]
    for each, grid in grids:
        cells = " x ".join(str(count) for count in grid.values.shape[2::-1])
        glow = "" if each.emission is None else ", emits light"
        yield "smoke", f"{each.name}: {cells} cells, densities up to {grid.values.max():.4g}{glow}"
        coefficients = f"scattering {triple(each.scattering)}, absorption {triple(each.absorption)}"
        yield "", f"{coefficients} per unit at density 1"
    medium = scene.medium
    if medium is None and grids:
        return
    if medium is None:
        yield "fog", "none: add one with --scattering"
        return
    place = "the whole space" if medium.mesh is None else medium.mesh.name
    yield "fog", f"scattering {triple(medium.scattering)}, absorption {triple(medium.absorption)} per unit"
    dims = "" if medium.surfaces else ", leaves surfaces as they are"
    yield "", f"anisotropy {medium.anisotropy:g}, fills {place}{dims}"
    near, far = colors_of_medium(medium, 1.0)
    yield "", f"a beam of power 1 and radius 1 shows {triple(near)}, one unit along {triple(far)}"


def _camera_rows(stage: Usd.Stage, time: Usd.TimeCode) -> list[tuple[str, ...]]:
    from pxr import UsdGeom

    from ..usd import stage as stages
    from ..usd.cameras.camera import read_shutter

    rows: list[tuple[str, ...]] = []
    to_mm = 1000 * UsdGeom.GetStageMetersPerUnit(stage)
    for name in stages.list_cameras(stage):
        try:
            camera = stages.read_camera(stage, name, time)
            begin, end = read_shutter(stage, name, time)
        except SceneError as error:
            rows.append((name, str(error).partition(f"{name}.")[2] or str(error), *("",) * 5))
            continue
        wide = camera.horizontal_aperture
        if camera.orthographic:
            lens, view = "orthographic", f"{wide:.4g} units wide"
        else:
            lens = f"{to_mm * camera.focal_length:.4g} mm on {to_mm * wide:.4g} mm"
            view = f"{2 * np.degrees(np.arctan(0.5 * wide / camera.focal_length)):.3g} degrees wide"
        shutter = f"{begin:g} to {end:g} frames" if begin < end else "no blur"
        stop = camera.focal_length / max(2 * camera.lens_radius, 1e-30)
        focus = f"f/{stop:.3g} at {camera.focus_distance:.4g}" if camera.lens_radius else "all sharp"
        rows.append((name, lens, view, shutter, focus, f"x {camera.exposure_scale:g}", triple(camera.to_world[:3, 3])))
    return rows


def _light_row(light: Light) -> tuple[str, ...]:
    beams = "none, but lights volumes" if getattr(light, "lights_media", False) else "none"
    if light.emits_beams:
        beams = "default" if light.beam_count is None else f"{light.beam_count:,}"
        beams += "" if light.beam_scale == 1.0 else f", x {light.beam_scale:g}"
    portal = "" if light.portal is None else light.portal.name
    kind = type(light).__name__.removesuffix("Light").lower()
    if kind == "flat":
        kind = "disk" if getattr(light, "disk", False) else "rect"
    if getattr(light, "image", None) is not None:
        kind += ", image"
    kind += "" if light.gobo is None else ", gobo"
    kind += "" if light.shaping is None or light.shaping.profile is None else ", profile"
    portal += "" if light.portal_gobo is None else ", gobo"
    return (light.name, kind, triple(light.radiance), light.group, beams, portal, _name(light.look))


def _watching(stage: Usd.Stage, time: Usd.TimeCode) -> dict[str, Camera]:
    """Return the first few valid cameras, by name."""
    from ..usd import stage as stages

    result = {}
    for name in stages.list_cameras(stage)[:CAMERAS_WATCHING]:
        with suppress(SceneError):
            result[name] = stages.read_camera(stage, name, time)
    return result


def _reach_rows(scene: Scene, watching: Mapping[str, Camera]) -> list[tuple[str, ...]]:
    """Return, for each lamp with beams, what part of its light gets into fog and what part each camera sees."""
    if not (scene.media and watching and any(light.emits_beams for light in scene.lights)):
        return []
    from ..transport.reach import reach_of_lamps
    from ..world.cameras.cameras import View, Window
    from ..world.described import world_of_scene

    world = world_of_scene(scene, [np.asarray(camera.to_world)[:3, 3] for camera in watching.values()])
    views = []
    for camera in watching.values():
        height = max(1, round(128 * camera.vertical_aperture / camera.horizontal_aperture))
        views.append(View(replace(camera, lens_radius=0.0), Window.full(128, height)).projection)
    reach = reach_of_lamps(world, views)
    return [(name, *map(_percent, (each.in_fog, *each.seen))) for name, each in reach.items()]


def _percent(fraction: float) -> str:
    return "none found" if fraction == 0 else f"{100 * fraction:.2g} %" if fraction < 0.995 else "all"


def _mesh_rows(meshes: Sequence[Mesh]) -> list[tuple[str, ...]]:
    """Return the first MESHES_SHOWN meshes in the stage's order, and one row for all others."""
    rows: list[tuple[str, ...]] = []
    for mesh in meshes[:MESHES_SHOWN]:
        diffuse = mesh.material.diffuse
        material = triple(diffuse) if isinstance(diffuse, tuple) else "varies from vertex to vertex"
        if not isinstance(diffuse, tuple) and hasattr(diffuse, "pixels"):
            material = f"{diffuse.pixels.shape[1]} px texture"
        rows.append((mesh.name, f"{len(mesh.points):,}", f"{len(mesh.faces):,}", material))
    if len(meshes) > MESHES_SHOWN:
        rest = meshes[MESHES_SHOWN:]
        triangles = sum(len(mesh.faces) for mesh in rest)
        rows.append((f"and {len(rest):,} more", f"{sum(len(mesh.points) for mesh in rest):,}", f"{triangles:,}", ""))
    return rows


def _look_rows(scene: Scene) -> Iterable[tuple[str, ...]]:
    looks: dict[str, Any] = {}
    for look in [light.look for light in scene.lights] + [drawn.look for drawn in scene.drawn]:
        if look is not None:
            looks[_name(look)] = look
    for name, look in looks.items():
        kinds = (("along", "falloff"), ("across", "profile"), ("eye", "falloff"), ("angle", "shading"))
        yield (name, *(_factor_words(getattr(look, "values", {}), *each) for each in kinds))


def _factor_words(values: Mapping[str, Any], factor: str, kind: str) -> str:
    """Return a description of a factor of a look on a stage: its kind, ramp, texture and expression."""
    words, knots = [str(values.get(f"{factor}:{kind}", ""))], values.get(f"{factor}:ramp:knots", ())
    if len(knots):
        words.append(f"ramp of {len(knots)}")
    if values.get(f"{factor}:texture") is not None:
        words.append("texture")
    if expression := values.get(f"{factor}:expression"):
        words.append(expression)
    return " x ".join(words)


# -- volumes --------------------------------------------------------------------------------------------------------


def volume_rows(path: Path) -> list[tuple[str, ...]]:
    """Return a row for each grid of a file; SceneError if it cannot be read."""
    try:
        with opened(path) as file:
            if path.suffix.lower() == ".vdb":
                return [_grid_row(each) for each in read_grids(file)]
            voxels = read_vol(file)
    except SceneError as error:
        raise SceneError(f"{path}: expected a grid that can be read, but {error}") from None
    values, size = voxels.values, np.abs(np.diag(voxels.to_file)[:3])
    shape = np.array(values.shape[2::-1])
    kind = "float" if values.ndim == 3 else "vec3s"
    return [
        ("", kind, "", f"{np.prod(shape):,}", _times(shape), triple(voxels.to_file[:3, 3]), triple(size / shape),
         _range([values]), _memory(values.nbytes), "none")
    ]  # fmt: skip


def _grid_row(grid: VDBGrid) -> tuple[str, ...]:
    kind = grid.type + (", half" if grid.half else "")
    word = str(grid.metadata.get("class", ""))
    size = "frustum" if grid.to_file is None else triple(np.linalg.norm(grid.to_file[:3, :3], axis=0))
    try:
        tree = grid.tree
    except SceneError:  # points and text have no voxels
        return (grid.name, kind, word, "not read", "", "", size, "", "", grid.codec)
    if tree.box is None:
        return (grid.name, kind, word, "none", "", "", size, "", "", grid.codec)
    low, high = tree.box
    parts = [values[masks] for _, masks, values in tree.leaves()]
    parts += [tile.value for tile in tree.tiles if tile.active]
    count = high - low + 1
    dense = 4 * tree.channels * float(np.prod(count.astype(np.float64)))
    return (grid.name, kind, word, f"{tree.active_voxels:,}", _times(count), " ".join(str(each) for each in low), size,
            _range(parts), _memory(dense), grid.codec)  # fmt: skip


def _range(parts: list[Array]) -> str:
    """Return a text with the least and the greatest value."""
    some = [part for part in parts if part.size]
    return f"{min(part.min() for part in some):.5g} to {max(part.max() for part in some):.5g}" if some else ""


def _times(counts: Array) -> str:
    return " x ".join(str(each) for each in counts)


def triple(values: Iterable[float]) -> str:
    """Return numbers in a row, or one number if all are the same."""
    words = [f"{value:.4g}" for value in values]
    return words[0] if len(set(words)) == 1 else " ".join(words)


def _memory(size: float) -> str:
    return f"{size / 1e6:,.1f} MB" if size >= 1e5 else f"{size / 1e3:,.1f} kB"


# -- text ------------------------------------------------------------------------------------------------------------


def _name(thing: object) -> str:
    return "" if thing is None else str(getattr(thing, "name", None) or type(thing).__name__)


def _table(columns: tuple[str, ...] | None, rows: Iterable[tuple[str, ...]], right: int = 0) -> Table:
    """Return a plain table, its last `right` columns aligned right; without `columns`, its first column is bold."""
    from rich.table import Table

    rows = list(rows)
    table = Table(show_header=columns is not None, box=None, pad_edge=False, header_style="bold")
    width = len(columns) if columns is not None else 2
    for index in range(width):
        options: Mapping[str, Any] = {"justify": "right"} if index >= width - right else {}
        style = "bold" if columns is None and index == 0 else ""
        table.add_column(columns[index] if columns else "", style=style, overflow="fold", **options)
    for row in rows:
        table.add_row(*row)
    return table
