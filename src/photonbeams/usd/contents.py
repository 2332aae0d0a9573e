"""Read a stage at one time, each prim with the reader for its kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..scene import Array, DrawnBeams, Light, Medium, Mesh, MeshLight, Scene
from .common.color_spaces import spaces_of
from .common.openusd import Usd, UsdGeom, UsdVol
from .common.reading import Cache, Reading, Time, quiet, target_paths
from .common.warnings import Warnings
from .geometry.instancers import Item, items
from .geometry.meshes import in_prototype, is_surface, read_meshes, tessellation
from .geometry.skinning import is_skinned
from .layers.clips import warn_of_gaps
from .lights.beam_settings import PHYSICAL, bound_look
from .lights.curves import is_drawn, read_curves, read_guides
from .lights.light import is_light, read_light
from .lights.links import linked
from .lights.mesh_lights import glowing_power, glows
from .media.medium import is_medium, read_media

_FEW = 64  # so few points have a hull with hardly fewer corners
_MOST_GLOWING = 8  # lamps that glowing surfaces become: kernels have code for each


@dataclass
class _Contents:
    meshes: list[Mesh] = field(default_factory=list)
    lights: list[tuple[Usd.Prim, Light]] = field(default_factory=list)
    drawn: list[DrawnBeams] = field(default_factory=list)
    media: list[tuple[Usd.Prim, Medium]] = field(default_factory=list)
    glowing: list[tuple[Item, list[Mesh]]] = field(default_factory=list)  # what emits light without being a lamp
    outlines: bool = False  # whether only the outlines of surfaces are read


class _Role(NamedTuple):
    """What a prim is rendered as; it may be several things at once."""

    medium: bool
    beams: bool  # drawn beams
    surface: bool
    light: bool


def read_scene(
    stage: Usd.Stage,
    time: Time = None,
    warnings: Warnings | None = None,
    base: Time = None,
    lasting: Cache | None = None,
    surfaces: dict[str, tuple[Array, list[Mesh]]] | None = None,
) -> Scene:
    """Return the meshes, lights, drawn beams and fog of a stage at a time.

    What cannot be read or rendered is left out with a warning to the logger "photonbeams".

    Parameters
    ----------
    time
        A time code, or a number; None is the default time.
    warnings
        Warnings that were already given, which are not repeated; new ones are added. They may be errors.
    base
        The frame from whose time samples velocities move points while the shutter is open; None: `time`.
    lasting
        Cache of what is the same at all times, shared by all readings of the stage; it is added to.
    surfaces
        Cache of the surfaces at this time, if no surface has changed since an earlier reading.

    Raises
    ------
    SceneError
        Something cannot be read, and warnings are errors.
    """
    reading = Reading(
        stage, time, warnings or Warnings(), base=base, lasting={} if lasting is None else lasting,
        surfaces={} if surfaces is None else surfaces,
    )  # fmt: skip
    spaces_of(stage, reading.warn)
    return _read(reading, outlines=False)


def with_looks(stage: Usd.Stage, time: Time, content: Scene, warnings: Warnings) -> Scene | None:
    """Return an earlier reading of a stage with the looks that its lights and drawn beams have now.

    The parameters are those of `read_scene`, and `content`, the scene that it returned. Return None if instancers
    repeat lights or beams, because the names of the copies do not lead to their prims.
    """
    reading = Reading(stage, time, warnings)
    if any("[" in name for name in content.looks()):
        return None

    def look(name: str) -> Any:
        prim = stage.GetPrimAtPath(name)
        return reading.attempt(prim, partial(bound_look, reading, prim), None, PHYSICAL)

    lights = tuple(replace(each, look=look(each.name)) for each in content.lights)
    return replace(content, lights=lights, drawn=tuple(replace(each, look=look(each.name)) for each in content.drawn))


def read_extent(stage: Usd.Stage, time: Time, lasting: Cache) -> Scene:
    """Return the extent of a stage at a time, as a scene whose surfaces are only the corners of their convex hulls.

    There are no warnings, because the time may never be rendered. `lasting` is the same as for `read_scene`.
    """
    return _read(Reading(stage, time, Warnings(muted=True), lasting=lasting), outlines=True)


def _read(reading: Reading, outlines: bool) -> Scene:
    # Points near the largest float may overflow in sums; the results are checked where it matters.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"), reading.warnings.together(), quiet():
        return _read_scene(reading, outlines)


def _read_scene(reading: Reading, outlines: bool) -> Scene:
    contents = _Contents(outlines=outlines)
    if not outlines:
        warn_of_gaps(reading)
    found = list(items(reading))
    lights = [item.prim for item in found if is_light(item.prim)]
    portals, guides = ({path for prim in lights for path in target_paths(prim, f"photonbeams:{name}")}
                       for name in ("portal", "guides"))  # fmt: skip
    for item in found:
        path = item.prim.GetPath()
        if path not in portals and (path not in guides or is_drawn(item.prim)):
            reading.attempt(item.prim, partial(_collect, reading, item, contents), None, "it is skipped")
    contents.lights += _lamps_that_glow(reading, contents)
    _keep_one_filling(reading, contents)
    media = [medium.name for _, medium in contents.media]

    def with_links(prim: Usd.Prim, light: Light) -> Light:
        read = partial(linked, reading, light, prim, contents.meshes, media)
        return light if outlines else reading.attempt(prim, read, light, "it lights everything")

    for number, (prim, light) in enumerate(contents.lights):
        if panes := light.windows():  # what is behind them, and all light, has their colors
            contents.meshes += panes
            contents.lights[number] = prim, replace(light, portal_gobo=None)
    return Scene(
        tuple(contents.meshes),
        tuple(with_links(prim, light) for prim, light in contents.lights),
        tuple(contents.drawn),
        tuple(medium for _, medium in contents.media),
    )


def _lamps_that_glow(reading: Reading, contents: _Contents) -> Iterator[tuple[Usd.Prim, MeshLight]]:
    """Yield the brightest surfaces that glow as lamps, with their prims; warn of the rest."""
    ranked = sorted(contents.glowing, key=lambda each: -glowing_power(each[1]))
    names = {item.name for item, _ in ranked[:_MOST_GLOWING]}
    for item, meshes in contents.glowing:
        if item.name not in names:
            others = f"glows, but lights nothing: only the {_MOST_GLOWING} brightest such surfaces are lamps"
            reading.warn(item.prim, others)
            continue
        read = partial(read_light, reading, item.prim, item.to_world, item.name, meshes)
        light = reading.attempt(item.prim, read, None, "it does not shine")
        if isinstance(light, MeshLight):
            yield item.prim, replace(light, both_sides=light.both_sides or _encloses(light, contents.meshes))


def _encloses(light: MeshLight, meshes: Sequence[Mesh]) -> bool:
    """Return whether a closed surface that glows has others in it, as a sky does."""
    assert light.mesh is not None
    low, high = light.mesh.used_points.min(axis=0), light.mesh.used_points.max(axis=0)
    middles = (0.5 * (each.points.min(axis=0) + each.points.max(axis=0)) for each in meshes
               if len(each.points) and not f"{each.name}/".startswith(f"{light.name}/"))  # fmt: skip
    return any(bool(np.all((low < each) & (each < high))) for each in middles)


def _keep_one_filling(reading: Reading, contents: _Contents) -> None:
    """Keep the first of the media that fill the whole space, and warn about the others."""
    kept: list[tuple[Usd.Prim, Medium]] = []
    first = None
    for prim, medium in contents.media:
        if medium.bounded or first is None:
            kept.append((prim, medium))
            first = first if medium.bounded else prim
        else:
            text = f"fills the whole space, as {first.GetPath()} does: expected one such medium, and the others on "
            reading.warn(prim, f"{text}closed gprims; it is skipped")
    contents.media = kept


def _role(reading: Reading, prim: Usd.Prim) -> _Role:
    """Return what a prim is rendered as, cached for its copies."""
    key = ("role", prim.GetPath())
    if key not in reading.cache:
        beams = is_drawn(prim)
        reading.cache[key] = _Role(is_medium(reading, prim), beams, is_surface(prim) and not beams, is_light(prim))
    role: _Role = reading.cache[key]
    return role


def _collect(reading: Reading, item: Item, contents: _Contents) -> None:
    prim = item.prim
    role = _role(reading, prim)
    if role.medium:
        media = read_media(reading, prim, item.to_world, item.name)
        contents.media += [(prim, medium) for medium in media]
        if media[0].bounded:
            return
    meshes: list[Mesh] = []
    if role.surface and contents.outlines and not role.light:
        meshes = [_outline(reading, prim, item.to_world, item.name)]
    elif role.surface:
        meshes = _meshes(reading, item)
    if role.light:
        read = partial(read_light, reading, prim, item.to_world, item.name, meshes)
        light = reading.attempt(prim, read, None, "it does not shine") if meshes else read()
        if light is not None:
            unguided: tuple[Array, ...] = ()
            guides = reading.attempt(prim, partial(read_guides, reading, prim), unguided, "the light has no guides")
            contents.lights.append((prim, replace(light, guides=guides)))
        if isinstance(light, MeshLight) and not light.surface:
            return
    contents.meshes.extend(meshes)
    if not role.light and any(map(glows, meshes)) and reading.flag(prim, "photonbeams:enabled", True):
        contents.glowing.append((item, meshes))
    if role.beams:
        drawn = read_curves(reading, prim, item.to_world, item.name)
        contents.drawn.extend([drawn] if drawn else [])
    elif prim.IsA(UsdGeom.Gprim) and not role.surface:
        lacking = " without a field: expected field:density, a relationship to a prim with a filePath"
        why = lacking if prim.IsA(UsdVol.Volume) else ", which is not rendered"
        reading.warn(prim, f"is a {prim.GetTypeName()}{why}; it is skipped")


def _meshes(reading: Reading, item: Item) -> list[Mesh]:
    """Return the meshes of a prim: the known ones of this time, if the prim has not moved."""
    known = reading.surfaces.get(item.name)
    if known is not None and np.array_equal(known[0], item.to_world):
        reading.triangles += sum(len(mesh.faces) for mesh in known[1])
        return known[1]
    meshes = read_meshes(reading, item.prim, item.to_world, item.name, item.instances)
    reading.surfaces[item.name] = item.to_world, meshes
    return meshes


def _outline(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> Mesh:
    """Return the corners of the convex hull of a prim's surface in world space, as a mesh without faces.

    A subdivision surface lies inside the hull of its cage.
    """
    skinned = is_skinned(prim)
    cache = reading.cache if skinned or reading.varies(prim) else reading.lasting
    key = ("outline", (prim if skinned else in_prototype(prim)).GetPath())
    if key not in cache:
        found = tessellation(reading, prim)
        empty = np.zeros((0, 3))
        cache[key] = empty if found is None else hull_corners(found.polygons.points[np.unique(found.polygons.indices)])
    points = cache[key] @ to_world[:3, :3].T + to_world[:3, 3]
    reading.within_reach(prim, points)
    return Mesh(name, points, np.zeros((0, 3), dtype=np.int64))


def hull_corners(points: Array) -> Array:
    """Return the points (P, 3) that are corners of their convex hull, or all if they lie in a plane or on a line."""
    if len(points) <= _FEW:
        return points
    from scipy.spatial import ConvexHull, QhullError  # takes long to import

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points
