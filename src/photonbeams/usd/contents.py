"""Read a stage at one time, each prim with the reader for its kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..scene import Array, DrawnBeams, Light, Medium, Mesh, MeshLight, Scene
from .common import schemas as schemas
from .common.openusd import Gf, Sdf, Usd, UsdGeom
from .common.reading import Reading, is_relationship, prims_under, quiet, target_paths, visible
from .common.selection import rendered_purposes
from .common.sizes import MESH, MOST_INSTANCES, room, step_of, triangles_about
from .common.warnings import Warnings
from .geometry.meshes import is_surface, read_meshes
from .geometry.outlines import read_outline
from .geometry.primvars import Instance
from .geometry.velocities import carried
from .lights.beam_settings import PHYSICAL, bound_look
from .lights.curves import guide_paths, is_drawn, read_curves, read_guides
from .lights.light import is_light, portal_paths, read_light
from .lights.links import linked
from .lights.mesh_lights import glowing_power, glows
from .media.medium import is_medium, read_medium

_MOST_GLOWING = 8  # lamps that glowing surfaces become: kernels have code for each
_WITH_ALL_BELOW = "it is skipped with all below it"
PROTOTYPE_PRIMS = Usd.PrimIsActive & Usd.PrimIsLoaded  # prototypes may be `over` or `class`


@dataclass
class _Contents:
    meshes: list[Mesh] = field(default_factory=list)
    lights: list[tuple[Usd.Prim, Light]] = field(default_factory=list)
    drawn: list[DrawnBeams] = field(default_factory=list)
    media: list[tuple[Usd.Prim, Medium]] = field(default_factory=list)
    glowing: list[tuple[_Item, list[Mesh]]] = field(default_factory=list)  # what emits light without being a lamp
    outlines: bool = False  # whether only the outlines of surfaces are read


class _Role(NamedTuple):
    """What a prim is rendered as; it may be several things at once."""

    medium: bool
    beams: bool  # drawn beams
    surface: bool
    light: bool


@dataclass(frozen=True)
class _Item:
    """A prim with its transform; a prim that an instancer repeats has one item for each copy."""

    prim: Usd.Prim
    to_world: Array
    name: str
    instances: tuple[Instance, ...] = ()  # innermost instancer first


def read_scene(
    stage: Usd.Stage,
    time: Any = None,
    warnings: Warnings | None = None,
    base: Any = None,
    lasting: dict[Any, Any] | None = None,
    surfaces: dict[Any, Any] | None = None,
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
    return _read(reading, outlines=False)


def with_looks(stage: Usd.Stage, time: Any, content: Scene, warnings: Warnings) -> Scene | None:
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


def read_extent(stage: Usd.Stage, time: Any, lasting: dict[Any, Any]) -> Scene:
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
    items = list(_items(reading, reading.stage.GetPseudoRoot()))
    lights = [item.prim for item in items if is_light(item.prim)]
    portals = {path for prim in lights for path in portal_paths(prim)}
    guides = {path for prim in lights for path in guide_paths(prim)}
    for item in items:
        path = item.prim.GetPath()
        if path not in portals and (path not in guides or is_drawn(item.prim)):
            reading.attempt(item.prim, partial(_collect, reading, item, contents), None, "it is skipped")
    if contents.glowing and not _has_light(reading):
        _light_by_glow(reading, contents)
    _keep_one_filling(reading, contents)
    media = [prim for prim, _ in contents.media]
    if outlines:
        return Scene(
            tuple(contents.meshes),
            tuple(light for _, light in contents.lights),
            tuple(contents.drawn),
            tuple(medium for _, medium in contents.media),
        )
    return Scene(
        tuple(contents.meshes),
        tuple(
            reading.attempt(
                prim, partial(linked, reading, light, prim, contents.meshes, media), light, "it lights everything"
            )
            for prim, light in contents.lights
        ),
        tuple(contents.drawn),
        tuple(medium for _, medium in contents.media),
    )


def _has_light(reading: Reading) -> bool:
    """Return whether a stage has a light or drawn beams, also hidden ones: films do not change when one is hidden."""
    drawn = (each for each in prims_under(reading.stage.GetPseudoRoot()) if is_light(each) or _is_drawn(each))
    return next(drawn, None) is not None


def _is_drawn(prim: Usd.Prim) -> bool:
    return bool(prim.IsA(UsdGeom.BasisCurves)) and is_drawn(prim)


def _light_by_glow(reading: Reading, contents: _Contents) -> None:
    """Make lamps of the brightest surfaces that glow, on a stage without a light or drawn beams."""
    ranked = sorted(contents.glowing, key=lambda each: -glowing_power(each[1]))
    names = {item.name for item, _ in ranked[:_MOST_GLOWING]}
    for item, meshes in contents.glowing:
        if item.name not in names:
            text = "glows, but lights nothing: the stage has no light, and only the"
            reading.warn(item.prim, f"{text} {_MOST_GLOWING} brightest surfaces are lamps")
            continue
        read = partial(read_light, reading, item.prim, item.to_world, item.name, meshes)
        light = reading.attempt(item.prim, read, None, "it does not shine")
        if isinstance(light, MeshLight):
            light = replace(light, both_sides=light.both_sides or _encloses(light, contents.meshes))
            contents.lights.append((item.prim, light))
            text = "glows and lights the scene, because the stage has no light: photonbeams:enabled = 1 on it means the"
            reading.warn(item.prim, f"{text} same, and 0 leaves the scene dark")


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
        beams = _is_drawn(prim)
        reading.cache[key] = _Role(is_medium(reading, prim), beams, is_surface(prim) and not beams, is_light(prim))
    role: _Role = reading.cache[key]
    return role


def _collect(reading: Reading, item: _Item, contents: _Contents) -> None:
    prim = item.prim
    role = _role(reading, prim)
    if role.medium:
        medium = read_medium(reading, prim, item.to_world, item.name)
        contents.media.append((prim, medium))
        if medium.bounded:
            return
    meshes: list[Mesh] = []
    if role.surface and contents.outlines and not role.light:
        meshes = [read_outline(reading, prim, item.to_world, item.name)]
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
        reading.warn(prim, f"is a {prim.GetTypeName()}, which is not rendered: it is skipped")


def _meshes(reading: Reading, item: _Item) -> list[Mesh]:
    """Return the meshes of a prim: the known ones of this time, if the prim has not moved."""
    known = reading.surfaces.get(item.name)
    if known is not None and np.array_equal(known[0], item.to_world):
        reading.triangles += sum(len(mesh.faces) for mesh in known[1])
        return known[1]
    meshes = read_meshes(reading, item.prim, item.to_world, item.name, item.instances)
    reading.surfaces[item.name] = item.to_world, meshes
    return meshes


def _items(reading: Reading, root: Usd.Prim) -> Iterator[_Item]:
    """Return all visible prims below a prim, with instances and point instances expanded."""
    scope = Usd.PrimRange(root, Usd.TraverseInstanceProxies())
    for prim in (walk := iter(scope)):
        if prim.IsPseudoRoot():
            continue
        if not visible(prim, reading.time):
            if UsdGeom.Imageable(prim).ComputeVisibility(reading.time) == "invisible":
                walk.PruneChildren()
            continue
        to_world = reading.attempt(prim, partial(reading.to_world, prim), None, _WITH_ALL_BELOW)
        if to_world is None or prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()  # prototypes are rendered where the instancer places them, not at their own place
        if to_world is not None:
            yield from _expanded(reading, _Item(prim, to_world, str(prim.GetPath())))


def _expanded(reading: Reading, item: _Item, within: tuple[Sdf.Path, ...] = ()) -> list[_Item]:
    """Return a prim or, for a point instancer, the prims of its prototypes at each of its points.

    `within` are the paths of instancers that repeat this one.
    """
    if not item.prim.IsA(UsdGeom.PointInstancer):
        return [item]
    return reading.attempt(item.prim, lambda: list(_instances(reading, item, within)), [], "it is skipped")


def _instances(reading: Reading, item: _Item, within: tuple[Sdf.Path, ...]) -> Iterator[_Item]:
    prim = item.prim
    if prim.GetPath() in within:
        raise reading.fail(prim, "prototypes", "contains the instancer itself: expected prims that do not")
    if not is_relationship(prim, "prototypes"):
        raise reading.fail(prim, "prototypes", "is an attribute: expected a relationship, rel")
    within = (*within, prim.GetPath())
    instancer = UsdGeom.PointInstancer(prim)
    prototypes = [reading.stage.GetPrimAtPath(path) for path in target_paths(prim, "prototypes")]
    moved = carried(reading, prim, "positions")
    sample = moved.reading if moved is not None else reading
    indices = sample.integers(prim, "protoIndices")
    if len(indices) > MOST_INSTANCES:
        text = f"has {len(indices):,} values: expected no more than {MOST_INSTANCES:,}"
        raise reading.fail(prim, "protoIndices", text)
    positions = sample.array(prim, "positions", 3) if moved is None else moved.points
    transforms = _instance_transforms(reading, sample, instancer, indices, positions, prototypes)
    mask = np.asarray(instancer.ComputeMaskAtTime(sample.time) or np.ones(len(indices), dtype=bool))
    parts = [list(_prototype_items(reading, root)) if root and root.IsActive() else None for root in prototypes]
    lost = [index for index in indices if not 0 <= index < len(parts) or parts[index] is None]
    if lost:
        text = f"names prototype {lost[0]}, which is not there: {len(lost)} of {len(indices)} instances are skipped"
        reading.warn(prim, text, "protoIndices")
    step = _step(reading, prim, indices, parts, within)
    for index, (number, matrix) in enumerate(zip(indices, transforms, strict=False)):
        if index % step or not (index >= len(mask) or mask[index]) or not 0 <= number < len(parts):
            continue
        local = item.to_world @ reading.matrix(prim, matrix)
        for part in parts[number] or ():
            instances = (Instance(prim, index), *item.instances)
            copy = _Item(part.prim, local @ part.to_world, f"{item.name}[{index}]{part.name}", instances)
            yield from _expanded(reading, copy, within)


def _step(
    reading: Reading, prim: Usd.Prim, indices: Array, parts: list[list[_Item] | None], within: tuple[Sdf.Path, ...]
) -> int:
    """Return n if every n-th instance is rendered: 1 if all fit into memory."""
    total = _triangles_of(reading, indices, parts, within)
    if len(within) > 1:  # an instancer that another one repeats was counted there
        return step_of(total, room())
    step = step_of(total, room() - reading.expected)
    reading.expected += total // step
    if step > 1:
        reading.warn(
            prim, f"has {len(indices):,} instances: one in {step} is rendered, to limit memory", "protoIndices"
        )
    return step


def _triangles_of(
    reading: Reading, indices: Array, parts: list[list[_Item] | None], within: tuple[Sdf.Path, ...]
) -> int:
    """Estimate how many triangles an instancer's copies of its prototypes have."""
    numbers = np.bincount(indices[(indices >= 0) & (indices < len(parts))], minlength=len(parts))
    sizes = [sum(_triangles_in(reading, each.prim, within) for each in part or ()) for part in parts]
    return sum(int(number) * size for number, size in zip(numbers, sizes, strict=True))


def _triangles_in(reading: Reading, prim: Usd.Prim, within: tuple[Sdf.Path, ...]) -> int:
    """Estimate how many triangles a prim of a prototype has; an instancer counts all of its copies."""
    key = ("about", prim.GetPath())
    if key not in reading.cache:
        size = 0
        if is_surface(prim):
            size = MESH + triangles_about(reading, prim)
        elif prim.IsA(UsdGeom.PointInstancer) and prim.GetPath() not in within:
            roots = [reading.stage.GetPrimAtPath(path) for path in target_paths(prim, "prototypes")]
            parts = [list(_prototype_items(reading, root)) if root and root.IsActive() else None for root in roots]
            indices = reading.attempt(prim, partial(reading.integers, prim, "protoIndices"), np.zeros(0, int), "")
            size = _triangles_of(reading, indices, parts, (*within, prim.GetPath()))
        reading.cache[key] = size
    return int(reading.cache[key])


def _instance_transforms(
    reading: Reading,
    sample: Reading,
    instancer: UsdGeom.PointInstancer,
    indices: Array,
    positions: Array | None,
    prototypes: list[Usd.Prim],
) -> Sequence[Gf.Matrix4d]:
    """Return one matrix per instance, hidden ones too, with the prototypes' own transforms."""
    prim, count = instancer.GetPrim(), len(indices)
    there = 0 if positions is None else len(positions)
    if there != count:
        text = f"has {there} values: expected {count}, as many as protoIndices; {min(there, count)} are rendered"
        reading.warn(prim, text, "positions")
    for name in ("orientations", "scales", "ids"):
        values = sample.value(prim, name, ())
        if not hasattr(values, "__len__"):
            raise reading.fail(prim, name, f"is {values}: expected a list of values")
        if len(values) not in (0, count):
            text = f"has {len(values)} values: expected {count}, as many as protoIndices; none of them is used"
            reading.warn(prim, text, name)
    # At the earliest time, which is infinitely long ago, velocities would move instances infinitely far.
    time = sample.time if reading.time.IsEarliestTime() else reading.time
    result: Sequence[Gf.Matrix4d] = instancer.ComputeInstanceTransformsAtTime(
        time,
        sample.time,
        UsdGeom.PointInstancer.IncludeProtoXform,
        UsdGeom.PointInstancer.IgnoreMask,
    )
    return result if len(result) == count else _placed(sample, prim, indices, positions, prototypes)


def _placed(
    sample: Reading, prim: Usd.Prim, indices: Array, positions: Array | None, prototypes: list[Usd.Prim]
) -> list[Gf.Matrix4d]:
    """Return the matrices of the instances that have all values; OpenUSD computes none if one lacks a value.

    Angular velocities are left out.
    """
    given = {name: sample.value(prim, name, ()) for name in ("orientations", "scales")}
    result = []
    for index, (number, position) in enumerate(zip(indices, () if positions is None else positions, strict=False)):
        matrix = Gf.Matrix4d(1)
        if 0 <= number < len(prototypes) and prototypes[number]:
            matrix, _ = sample.xforms.GetLocalTransformation(prototypes[number])
        if len(given["scales"]) == len(indices):
            matrix = matrix * Gf.Matrix4d().SetScale(Gf.Vec3d(given["scales"][index]))
        if len(given["orientations"]) == len(indices):
            matrix = matrix * Gf.Matrix4d().SetRotate(Gf.Quatd(given["orientations"][index]))
        result.append(matrix * Gf.Matrix4d().SetTranslate(Gf.Vec3d(*map(float, position))))
    return result


def _prototype_items(reading: Reading, root: Usd.Prim) -> Iterator[_Item]:
    """Return the prims of a prototype, with transforms relative to its root."""
    walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(PROTOTYPE_PRIMS)))
    for prim in walk:
        if prim.IsA(UsdGeom.Imageable) and not shown_in_prototype(reading, prim):
            walk.PruneChildren()
            continue
        to_root = reading.attempt(
            prim, partial(_relative, reading, prim, root), None, "it is skipped with all below it"
        )
        relative = str(prim.GetPath().MakeRelativePath(root.GetPath()))
        if to_root is not None:
            yield _Item(prim, to_root, "" if relative == "." else f"/{relative}")
        if to_root is None or prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()


def _relative(reading: Reading, prim: Usd.Prim, root: Usd.Prim) -> Array:
    """Return the transform of a prim of a prototype to the prototype's root."""
    matrix, _ = reading.xforms.ComputeRelativeTransform(prim, root)
    return reading.matrix(prim, matrix)


def shown_in_prototype(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether a prim of a prototype is rendered with it, judged by the prim itself."""
    # An invisible ancestor of the prototype does not hide its instances.
    purpose = reading.value(prim, "purpose", "default")
    return reading.value(prim, "visibility", "inherited") != "invisible" and purpose in rendered_purposes(reading.stage)
