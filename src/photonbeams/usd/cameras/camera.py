"""Read a UsdGeomCamera as the renderer's camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...scene import FARTHEST, Array, Camera, SceneError
from ...scene.vectors import unit
from ..common.openusd import Usd, UsdGeom
from ..common.reading import LOG, Reading, Time, file_of, prims_under, quiet, target_paths
from ..common.selection import settings_at
from ..common.warnings import Warnings
from .panoramas import Panorama, read_panorama

# UsdGeomCamera: focal length and apertures are in tenths of a scene unit.
_TENTH = 0.1
_RATIO = 1e5  # largest ratio of a camera's lengths to each other
_BRIGHTEST = 1e12  # largest factor on light: sums over passes stay far below the limit of single precision


def list_cameras(stage: Usd.Stage) -> list[str]:
    """Return the paths of all cameras, in the order of the stage."""
    return [str(prim.GetPath()) for prim in prims_under(stage.GetPseudoRoot()) if prim.IsA(UsdGeom.Camera)]


def read_camera(
    stage: Usd.Stage, name: str | None = None, time: Time = None, warnings: Warnings | None = None
) -> Camera:
    """Return a camera by its path or name; by default the one of the render settings, or else the first.

    `warnings` is the same as for `read_scene`.

    Raises
    ------
    SceneError
        There is no camera, none or several of that name, or its apertures or lens make no picture.
    """
    reading = Reading(stage, time, warnings or Warnings())
    with quiet():
        return _camera(reading, chosen_camera(stage, name, warnings))


def read_shutter(stage: Usd.Stage, name: str | None = None, time: Time = None) -> tuple[float, float]:
    """Return when a camera's shutter opens and closes, in time codes relative to the frame; raises SceneError."""
    reading = Reading(stage, time)
    prim = chosen_camera(stage, name)
    begin, end = (reading.number(prim, f"shutter:{which}", 0.0) for which in ("open", "close"))
    if end < begin:
        text = f"is {end:g} but shutter:open is {begin:g}: expected a shutter that does not close before it opens"
        raise reading.fail(prim, "shutter:close", text)
    return begin, end


def chosen_camera(stage: Usd.Stage, name: str | None, warnings: Warnings | None = None) -> Usd.Prim:
    """Return the prim of the camera that `read_camera` reads."""
    paths = list_cameras(stage)
    if not paths:
        raise SceneError(f"{file_of(stage)} has no camera: expected a Camera prim")
    if name is None:
        settings = settings_at(stage)
        named = [str(path) for path in target_paths(settings.GetPrim(), "camera")[:1]] if settings else []
        if named and named[0] not in paths and warnings is not None:
            text = f"the render settings name {named[0]}, which is not a camera: {paths[0]} is used"
            warnings.give(text, file_of(stage))
        elif not named and len(paths) > 1:
            LOG.info("%s: of %d cameras the first is used: %s", file_of(stage), len(paths), paths[0])
        return stage.GetPrimAtPath(next((path for path in named if path in paths), paths[0]))
    fitting = [path for path in paths if path == name] or [path for path in paths if path.endswith(f"/{name}")]
    if len(fitting) != 1:
        many, expected = ("several cameras", fitting) if fitting else ("no camera", paths)
        raise SceneError(f"{file_of(stage)} has {many} '{name}': expected one of {', '.join(expected)}")
    return stage.GetPrimAtPath(fitting[0])


def _camera(reading: Reading, prim: Usd.Prim) -> Camera:
    def length(name: str, default: float) -> float:
        return _TENTH * reading.positive(prim, name, default)

    def offset(name: str) -> float:
        return _TENTH * reading.number(prim, name, 0.0)

    panorama = read_panorama(reading, prim)
    orthographic = reading.value(prim, "projection", "perspective") == "orthographic"
    clipping = reading.attempt(prim, lambda: _clipping(reading, prim), (0.0, FARTHEST), "nothing is clipped")
    radius, focus = 0.0, 0.0
    if panorama is not None and reading.value(prim, "fStop"):
        reading.warn(prim, "is not used: a panoramic camera has all in focus", "fStop")
    elif not orthographic:
        radius, focus = reading.attempt(prim, lambda: _lens(reading, prim), (0.0, 0.0), "all is in focus")
    camera = Camera(
        str(prim.GetPath()),
        _rigid(reading, prim),
        focal_length=_TENTH * reading.number(prim, "focalLength", 50.0) if orthographic else length("focalLength", 50),
        horizontal_aperture=length("horizontalAperture", 20.955),
        vertical_aperture=length("verticalAperture", 15.2908),
        horizontal_offset=offset("horizontalApertureOffset"),
        vertical_offset=offset("verticalApertureOffset"),
        projection="orthographic" if orthographic else "perspective",
        clipping=clipping,
        lens_radius=radius,
        focus_distance=focus,
        exposure_scale=reading.attempt(prim, lambda: _exposure_scale(reading, prim), 1.0, "its exposure is left out"),
    )
    _check_proportions(reading, prim, camera)
    return camera if panorama is None else _panoramic(reading, prim, camera, panorama)


def _panoramic(reading: Reading, prim: Usd.Prim, camera: Camera, panorama: Panorama) -> Camera:
    """Return the panoramic camera at the place of one in perspective; SceneError for a field that it cannot have."""
    try:
        result = Camera.panorama(
            camera.name, camera.to_world, panorama.projection, panorama.field, clipping=camera.clipping,
            exposure_scale=camera.exposure_scale,
        )  # fmt: skip
    except SceneError as error:
        raise SceneError(f"{file_of(reading.stage)}: {error}") from None
    across = panorama.shift[0] + camera.horizontal_offset / camera.horizontal_aperture
    down = panorama.shift[1] + camera.vertical_offset / camera.vertical_aperture
    return replace(
        result, horizontal_offset=across * result.horizontal_aperture, vertical_offset=down * result.vertical_aperture
    )


def _clipping(reading: Reading, prim: Usd.Prim) -> tuple[float, float]:
    """Return the near and the far clipping distance of a camera."""
    near, far = reading.vector(prim, "clippingRange", (1.0, 1e6))
    if not 0 <= near < far < np.inf:
        raise reading.fail(prim, "clippingRange", f"is ({near:g}, {far:g}): expected a near distance before a far one")
    return near, far


def _lens(reading: Reading, prim: Usd.Prim) -> tuple[float, float]:
    """Return the radius of a camera's lens and its focus distance; an fStop of 0 is a pinhole."""
    stop = reading.number(prim, "fStop", 0.0, minimum=0.0)
    focus = reading.number(prim, "focusDistance", 0.0, minimum=0.0)
    if stop == 0:
        return 0.0, focus
    if focus == 0:
        raise reading.fail(prim, "focusDistance", f"is 0 but fStop is {stop:g}: expected a positive focus distance")
    return _TENTH * reading.number(prim, "focalLength", 50.0) / (2 * stop), focus


def _exposure_scale(reading: Reading, prim: Usd.Prim) -> float:
    """Return the factor of a camera's exposure, as UsdGeomCamera defines it: 1 where nothing is authored."""
    reading.number(prim, "exposure", 0.0, -100.0, 100.0)
    for name in ("iso", "time", "responsivity"):
        reading.number(prim, f"exposure:{name}", 1.0, minimum=0.0)
    reading.positive(prim, "exposure:fStop", 1.0)
    scale = float(UsdGeom.Camera(prim).ComputeLinearExposureScale(reading.time))
    if scale == 0:
        dark = [name for name in ("iso", "time", "responsivity") if reading.value(prim, f"exposure:{name}") == 0]
        name = f"exposure:{dark[0]}" if dark else "exposure"
        reading.warn(prim, "multiplies all light by 0: the picture is black", name)
    if not scale <= _BRIGHTEST:
        text = f"and the other exposure attributes multiply light by {scale:g}: expected at most {_BRIGHTEST:g}"
        raise reading.fail(prim, "exposure", text)
    return scale


def _check_proportions(reading: Reading, prim: Usd.Prim, camera: Camera) -> None:
    """Raise SceneError for extreme ratios of focal length and apertures, which single precision cannot resolve."""
    wide = camera.horizontal_aperture
    lengths = {
        "verticalAperture": camera.vertical_aperture,
        "focalLength": wide if camera.orthographic else camera.focal_length,
        "horizontalApertureOffset": camera.horizontal_offset,
        "verticalApertureOffset": camera.vertical_offset,
    }
    for name, value in lengths.items():
        if abs(value) > _RATIO * wide or (not name.endswith("Offset") and value * _RATIO < wide):
            text = f"is {value / _TENTH:g} with horizontalAperture {wide / _TENTH:g}: expected a ratio below {_RATIO:g}"
            raise reading.fail(prim, name, text)


def _rigid(reading: Reading, prim: Usd.Prim) -> Array:
    """Return a camera's position and orientation, without scale, shear and mirroring, as a (4, 4) transform."""
    matrix = reading.to_world(prim)
    back = unit(matrix[:3, 2])
    right = unit(np.cross(matrix[:3, 1], back))
    if not np.any(back) or not np.any(right):
        raise reading.fail(prim, "", "is scaled to zero: expected a transform that can be inverted")
    result = np.eye(4)
    result[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    result[:3, 3] = matrix[:3, 3]
    return result
