"""What a stage holds: its units, fog, cameras, lights, looks and meshes, and what its light does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...constants import DEFAULT_BEAMS
from ...scene import Camera, FogDensity, Light, Medium, Mesh, Scene, SceneError
from ...shot.lent import VIEW, lit, view_of
from ...shot.survey import Survey
from ...usd import stage as stages
from ...usd.cameras.camera import read_shutter
from ...usd.common.openusd import UsdGeom
from ...usd.common.reading import Reading
from ...usd.common.warnings import Warnings
from ...usd.groups import hidden_lights
from ...usd.layers.frames import time_range
from ...usd.unread import warn_of_unread
from ...world.bounds import box_of_states
from .advice import advice
from .words import percent, triple, units

if TYPE_CHECKING:
    from pxr import Usd

#: Columns, or None without a header; and rows.
Table = tuple[tuple[str, ...] | None, list[tuple[str, ...]]]

# The most rows of meshes, and lights of which it is told what they do; and how many cameras watch that.
_MESHES, _LIGHTS, _WATCHING = 12, 12, 3
_FEWEST = 3  # rows of meshes: of fewer, those of the next level are shown, or the largest of them


def tables(path: Path, layers: Sequence[Path]) -> Iterator[Table]:
    """Yield the tables about a stage; SceneError if it cannot be read."""
    stage = stages.open_stage(path, layers)
    warn_of_unread(stage, Warnings())
    time = stages.default_time(stage)
    scene = stages.read_scene(stage, time)
    cameras = watching(stage, time, scene)
    if cameras:
        scene = lit(Reading(stage, time, Warnings(muted=True)), scene, next(iter(cameras.values())))
    survey = Survey(scene, cameras)
    yield None, list(_stage_rows(stage, survey))
    yield ("camera", "lens", "view", "shutter", "focus", "exposure", "position"), _camera_rows(stage, time)
    lights = [_light_row(light) for light in scene.lights] + _hidden_rows(stage, time)
    yield ("light", "kind", "radiance", "group", "beams", "portal", "look"), lights
    yield ("light", "what it does"), [*_light_words(survey, _meters(stage))]
    drawn: list[tuple[str, ...]] = [
        (each.name, f"{len(each.start):,}", each.group, _name(each.look)) for each in scene.drawn
    ]
    yield ("drawn beams", "count", "group", "look"), drawn
    yield ("look", "along", "across", "eye", "angle"), list(_look_rows(scene))
    yield ("mesh", "meshes", "points", "triangles", "material"), mesh_rows(scene.meshes)
    yield ("why it would be dark or blurred", "what to type"), [*advice(stage, time, survey)]


def watching(stage: Usd.Stage, time: Usd.TimeCode, scene: Scene) -> dict[str, Camera]:
    """Return the first few valid cameras, by name, or the view of all; the one that a render takes comes first."""
    names = stages.list_cameras(stage)
    if not names:
        box = box_of_states([scene])
        return {VIEW: view_of(box, stages.up_axis_name(stage))} if box else {}
    with suppress(SceneError):
        names.insert(0, stages.read_camera(stage, None, time).name)
    result = {}
    for name in dict.fromkeys(names):
        with suppress(SceneError):
            result[name] = stages.read_camera(stage, name, time)
        if len(result) == _WATCHING:
            break
    return result


def _meters(stage: Usd.Stage) -> float:
    return float(UsdGeom.GetStageMetersPerUnit(stage))


# -- the stage and its fog -------------------------------------------------------------------------------------------


def _stage_rows(stage: Usd.Stage, survey: Survey) -> Iterator[tuple[str, str]]:
    scene = survey.scene
    yield "up axis", str(UsdGeom.GetStageUpAxis(stage))
    yield "unit", f"{_meters(stage):g} m"
    ends = time_range(stage)
    frames = "no range" if ends is None else f"{ends[0]:g} to {ends[1]:g}"
    yield "frames", f"{frames}, {stage.GetTimeCodesPerSecond():g} a second"
    yield "triangles", f"{sum(len(mesh.faces) for mesh in scene.meshes):,} in {len(scene.meshes):,} meshes"
    yield "bounces", f"{scene.bounces}"
    grids = [(each, each.grid) for each in scene.media if each.grid is not None]
    for each, grid in grids:
        cells = " x ".join(str(count) for count in grid.values.shape[2::-1])
        glow = "" if each.emission is None else ", emits light"
        yield "smoke", f"{each.name}: {cells} cells, densities up to {grid.values.max():.4g}{glow}"
        coefficients = f"scattering {triple(each.scattering)}, absorption {triple(each.absorption)}"
        yield "", f"{coefficients} per unit at density 1"
    if scene.medium is not None:
        yield from _fog_rows(scene.medium, survey, _meters(stage))
    elif not grids:
        yield "fog", "none"


def _fog_rows(medium: Medium, survey: Survey, meters: float) -> Iterator[tuple[str, str]]:
    place = "the whole space" if medium.mesh is None else medium.mesh.name
    yield "fog", f"scattering {triple(medium.scattering)}, absorption {triple(medium.absorption)} per unit"
    dims = "" if medium.surfaces else ", leaves surfaces as they are"
    yield "", f"anisotropy {medium.anisotropy:g}, fills {place}{dims}"
    if medium.varies and medium.density is not None:
        yield "", " and ".join(_variations(medium.density))
    extinction = np.maximum(medium.extinction, 1e-30)
    half = np.log(2) / extinction
    yield "", f"half of a shaft's light is left after {_lengths(half, meters)} of it"
    if survey.cameras and medium.mesh is None and not medium.varies:
        left = np.exp(-extinction * survey.distance)
        seen = f"of what {next(iter(survey.cameras))} sees, about {units(survey.distance, meters)} away"
        yield "", f"{seen}, {' '.join(dict.fromkeys(map(percent, left)))} of the light is left"


def _variations(density: FogDensity) -> Iterator[str]:
    if density.falloff is not None:
        yield f"falls to 1 / e over {density.falloff:g} above the height {density.ground:g}"
    if density.noise is not None:
        yield f"has wisps of up to {density.noise.scale:g} units"


def _lengths(values: Iterable[float], meters: float) -> str:
    *others, last = dict.fromkeys(f"{float(f'{each:.3g}'):g}" for each in values)
    return " or ".join([*others, units(float(last), meters)]) + (" (by colour)" if others else "")


# -- cameras and lights ----------------------------------------------------------------------------------------------


def _camera_rows(stage: Usd.Stage, time: Usd.TimeCode) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    to_mm = 1000 * _meters(stage)
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
        elif camera.panoramic:
            lens, view = camera.projection, f"{camera.angle:.3g} degrees wide"
        else:
            lens = f"{to_mm * camera.focal_length:.4g} mm on {to_mm * wide:.4g} mm"
            view = f"{2 * np.degrees(np.arctan(0.5 * wide / camera.focal_length)):.3g} degrees wide"
        shutter = f"{begin:g} to {end:g} frames" if begin < end else "no blur"
        stop = camera.focal_length / max(2 * camera.lens_radius, 1e-30)
        focus = f"f/{stop:.3g} at {camera.focus_distance:.4g}" if camera.lens_radius else "all sharp"
        rows.append((name, lens, view, shutter, focus, f"x {camera.exposure_scale:g}", triple(camera.to_world[:3, 3])))
    return rows


def _light_row(light: Light) -> tuple[str, ...]:
    beams = "none, but lights fog" if getattr(light, "lights_media", False) else "none"
    if light.emits_beams:
        beams = f"{DEFAULT_BEAMS if light.beam_count is None else light.beam_count:,}"
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


def _hidden_rows(stage: Usd.Stage, time: Usd.TimeCode) -> list[tuple[str, ...]]:
    """Return a row for each light that is hidden when the stage starts: a film may show it later."""
    return [(path, "hidden at first", "", "", "none yet", "", "") for path in hidden_lights(stage, time)]


def _light_words(survey: Survey, meters: float) -> Iterator[tuple[str, str]]:
    """Yield what the light of each lamp does: on surfaces, in fog, and through openings."""
    shown = survey.scene.lights[:_LIGHTS] if survey.cameras else ()
    for light in shown:
        for index, camera in enumerate(survey.cameras):
            fraction, level = survey.white(camera, light.name)
            lit = f"; white paper there shows {level:.2g} (1 is white)" if fraction else ""
            yield "" if index else light.name, f"lights {percent(fraction)} of what {camera} sees{lit}"
        if light.name in survey.reach:
            yield "", _fog_words(survey, light.name)
        for corner, x, y in survey.openings.get(light.name, ()):
            wide = f"{np.linalg.norm(x):.3g} x {units(float(np.linalg.norm(y)), meters)}"
            yield "", f"comes in through an opening of {wide}, its middle at {triple(corner + 0.5 * (x + y))}"
    if len(survey.scene.lights) > len(shown) > 0:
        yield f"and {len(survey.scene.lights) - len(shown):,} more", ""


def _fog_words(survey: Survey, name: str) -> str:
    fog = "fog" if survey.scene.media else "a fog"
    reach = survey.reach[name]
    seen = (f"{camera} sees {percent(each)}" for camera, each in zip(survey.cameras, reach.seen, strict=True))
    return f"{percent(reach.in_fog)} of its light gets into {fog}, of which {', '.join(seen)}"


# -- looks and meshes ------------------------------------------------------------------------------------------------


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


def mesh_rows(meshes: Sequence[Mesh]) -> list[tuple[str, ...]]:
    """Return a row for each mesh or, of many, for the prims that hold them: as deep on the stage as rows suffice."""
    by_path = [(mesh.name.split("/"), mesh) for mesh in meshes]
    groups: dict[str, list[Mesh]] = {}
    for depth in range(2, 2 + max((len(parts) for parts, _ in by_path), default=0)):
        if len(groups) > _MESHES:
            break
        deeper: dict[str, list[Mesh]] = {}
        for parts, mesh in by_path:
            deeper.setdefault("/".join(parts[:depth]), []).append(mesh)
        if len(groups) >= _FEWEST and len(deeper) > _MESHES:
            break
        groups = deeper
    largest = sorted(groups.items(), key=lambda each: -sum(len(mesh.faces) for mesh in each[1]))
    shown, rest = dict(largest[:_MESHES]), [mesh for _, own in largest[_MESHES:] for mesh in own]
    rows = [_mesh_row(name if len(own) == 1 else f"{name}/…", own) for name, own in groups.items() if name in shown]
    return rows + ([_mesh_row("and others", rest)] if rest else [])


def _mesh_row(name: str, meshes: Sequence[Mesh]) -> tuple[str, ...]:
    materials = dict.fromkeys(_material(mesh) for mesh in meshes)
    material = next(iter(materials)) if len(materials) == 1 else f"{len(materials):,} materials"
    points, triangles = (sum(len(getattr(mesh, each)) for mesh in meshes) for each in ("points", "faces"))
    return (meshes[0].name if len(meshes) == 1 else name, f"{len(meshes):,}", f"{points:,}", f"{triangles:,}", material)


def _material(mesh: Mesh) -> str:
    diffuse = mesh.material.diffuse
    if isinstance(diffuse, tuple):
        return triple(diffuse)
    return f"{diffuse.pixels.shape[1]} px texture" if hasattr(diffuse, "pixels") else "varies from vertex to vertex"


def _name(thing: object) -> str:
    return "" if thing is None else str(getattr(thing, "name", None) or type(thing).__name__)
