"""Read media, by `PhotonBeamsMediumAPI` or materials: in closed gprims, in volumes of fields, and in all of space."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...images.color_spaces import REC709, ColorSpaces
from ...scene import Array, Color, DensityGrid, FogDensity, FogNoise, Medium, Mesh, SceneError
from ...scene.checks import shown
from ...world.media.medium_colors import BRIGHTEST, DARKEST, coefficients
from ..common.color_spaces import to_working
from ..common.definitions import MEDIUM, read_attribute
from ..common.openusd import Usd, UsdGeom, UsdLux, UsdVol
from ..common.reading import Reading, has_photonbeams
from ..geometry.meshes import is_closed, is_gprim, read_solid
from ..materials.bound import bound_to
from .boxes import box_around
from .volume_shaders import VolumeEmission, VolumeShading, read_shading
from .volumes import DENSITY, field_of, fields_of, read_density, read_field

# The radiance of a black body over T⁴, as in Blender's volumes: the Stefan-Boltzmann constant, in 1e6 W / m², over π.
_RADIANCE = 5.670374e-14 / np.pi
_UNLIT = "emits light that only cameras see: it lights no surfaces and makes no beams"
_GLOWS = 798  # kelvin: the Draper point, from which on what is hot is seen to glow
_COLDEST, _HOTTEST = 1000, 10000  # kelvin: the range for which OpenUSD knows the colours


def is_medium(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether a prim is fog: by photonbeams' attributes, as a volume of fields, or by its volume material."""
    return _has_medium(prim) or (prim.IsA(UsdVol.Volume) and bool(fields_of(prim))) or _is_filled(reading, prim)


def _is_filled(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether a gprim has a material with a volume and no surface."""
    material = bound_to(reading, prim) if is_gprim(prim) else None
    if material is None or any(each.HasConnectedSource() for each in material.GetSurfaceOutputs()):
        return False
    return any(each.HasConnectedSource() for each in material.GetVolumeOutputs())


def _has_medium(prim: Usd.Prim) -> bool:
    return has_photonbeams(prim, MEDIUM, "scattering", "absorption", "nearColor", "farColor")


def read_media(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> list[Medium]:
    """Return the medium of a prim, which fills a closed gprim or a grid; that of any other prim fills all of space.

    It is that of photonbeams' attributes, or else of the material's shader. Parts of a large grid that are far apart
    are media of their own, whose names have a number.
    """
    own, volume = _has_medium(prim), prim.IsA(UsdVol.Volume)
    if not (own or volume or is_closed(reading, prim)):
        raise reading.fail(prim, "", "has a volume material: expected a closed mesh")
    shading = VolumeShading(*_coefficients(reading, prim)) if own else read_shading(reading, prim)
    parts = _in_grids(reading, prim, to_world, shading) if volume else [{"mesh": _filled(reading, prim, to_world)}]
    medium = Medium(
        shading.scattering,
        shading.absorption,
        anisotropy=_attribute(reading, prim, "anisotropy", shading.anisotropy),
        surfaces=_attribute(reading, prim, "surfaces"),
        name=name,
        bounces=_attribute(reading, prim, "bounces"),
        density=_density(reading, prim),
        **{"emission": _even_glow(reading, prim, shading), **parts[0]},
    )
    others = enumerate(parts[1:], 2)
    return [medium, *(replace(medium, name=f"{name}[part {number}]", **part) for number, part in others)]


def _attribute(reading: Reading, prim: Usd.Prim, name: str, default: object = None) -> Any:
    """Return an attribute of the medium's schema, as `read_attribute` does."""
    return read_attribute(reading, prim, MEDIUM, name, default=default)


def _density(reading: Reading, prim: Usd.Prim) -> FogDensity | None:
    """Return how the density of fog varies, or None; that of a volume is its field's."""
    falloff, ground = (_attribute(reading, prim, f"height:{name}") for name in ("falloff", "ground"))
    amount = _attribute(reading, prim, "noise:amount")
    if not (falloff or amount):
        return None
    if prim.IsA(UsdVol.Volume):
        name = "photonbeams:height:falloff" if falloff else "photonbeams:noise:amount"
        reading.warn(prim, "is not used: a Volume has the density of its field", name)
        return None
    noise = None
    if amount:
        names = ("scale", "octaves", "contrast", "drift", "evolution")
        noise = FogNoise(amount, **{name: _attribute(reading, prim, f"noise:{name}") for name in names})
    return FogDensity(falloff or None, ground, noise)


def _filled(reading: Reading, prim: Usd.Prim, to_world: Array) -> Mesh | None:
    """Return the box or gprim that a medium fills, or None, with a warning if that is another than the prim's shape."""
    if boxed := [str(each.GetPath()) for each in reading.targets(prim, "photonbeams:box")]:
        try:
            return box_around(reading.stage, boxed, str(prim.GetPath()), reading.time)
        except SceneError as error:
            raise reading.fail(prim, "photonbeams:box", f"names no space for fog: {error}") from None
    if is_gprim(prim) and is_closed(reading, prim):
        return read_solid(reading, prim, to_world)
    if is_gprim(prim):
        reading.warn(prim, "is not closed: its fog fills the whole space")
    elif prim.IsA(UsdGeom.Gprim):
        reading.warn(prim, f"is a {prim.GetTypeName()}, which holds no fog: it fills the whole space")
    return None


def _in_grids(reading: Reading, prim: Usd.Prim, to_world: Array, shading: VolumeShading) -> list[dict[str, Any]]:
    """Return what the fields of a volume give to its medium; of a density alone, to the medium of each part."""
    colors = reading.attempt(prim, lambda: _colors(reading, prim, to_world, shading), None, "its colour is even")
    emission = reading.attempt(prim, lambda: _glow(reading, prim, to_world, shading), None, "it emits no light")
    apart = colors is None and emission is None
    grids = read_density(reading, prim, to_world, shading.density, apart=apart)
    fields = {"scattering_color": colors, "emission": emission}
    return [{"grid": grid, **{name: field for name, field in fields.items() if field is not None}} for grid in grids]


def _colors(reading: Reading, prim: Usd.Prim, to_world: Array, shading: VolumeShading) -> DensityGrid | None:
    """Return factors on a volume's scattering, from the field that its shader names; None if there is none."""
    field = field_of(reading, prim, shading.color) if shading.color else None
    if field is None:
        return None
    (grid,) = read_field(reading, prim, field, to_world)
    if (most := float(grid.values.max())) > 1 + 1e-3:
        reading.warn(field, f"holds colours up to {most:g}: those above 1 count as 1")
    return DensityGrid(np.minimum(grid.values, 1), grid.to_world)


def _glow(reading: Reading, prim: Usd.Prim, to_world: Array, shading: VolumeShading) -> DensityGrid | None:
    """Return what a volume emits, or None; a shader may name a temperature field that the volume lacks."""
    emission = shading.emission
    field = None if emission is None else field_of(reading, prim, emission.field)
    if emission is None or field is None:
        return None
    (grid,) = read_field(reading, prim, field, to_world)
    result = _emitted(grid, emission, reading.spaces)
    if emission.kelvin and (hottest := emission.kelvin * float(grid.values.max(initial=0.0))) < _GLOWS:
        text = f"is {hottest:.3g} K at its hottest, too cold to glow: expected {_GLOWS} to {_HOTTEST} K, by the field"
        reading.warn(prim, f"{text} {emission.field} times the shader's {emission.kelvin:g}")
    else:
        reading.warn(prim, _UNLIT)
    return result


def _even_glow(reading: Reading, prim: Usd.Prim, shading: VolumeShading) -> Color | None:
    """Return what even fog emits, by its attribute or its shader, or None."""
    shader, usual = None if prim.IsA(UsdVol.Volume) else shading.emission, None
    if shader is not None and shader.field == DENSITY:
        usual = shader.color
    elif shader is not None and not shader.kelvin:
        reading.warn(prim, f"has no field {shader.field}, by which its shader says that it emits light: it emits none")
    emitted = _attribute(reading, prim, "emission", usual)
    if emitted is None or not any(emitted):
        return None
    if prim.IsA(UsdVol.Volume):
        reading.warn(prim, "is even, which is not rendered on a grid: it is ignored", "photonbeams:emission")
        return None
    reading.warn(prim, _UNLIT)
    return tuple(emitted)  # type: ignore[return-value]


def _emitted(field: DensityGrid, emission: VolumeEmission, spaces: ColorSpaces) -> DensityGrid:
    """Return the radiance that a volume emits per scene unit."""
    values = field.values if field.values.ndim == 4 else field.values[..., None]
    if emission.kelvin:
        kelvin = values.mean(axis=-1).astype(np.float64) * emission.kelvin
        table = np.linspace(_COLDEST, _HOTTEST, 181)
        rgb = np.array([UsdLux.BlackbodyTemperatureAsRgb(float(each)) for each in table])
        colors = np.maximum(to_working(rgb, REC709, spaces), 0)
        chroma = np.stack([np.interp(kelvin, table, channel) for channel in colors.T], axis=-1)
        values = chroma * (_RADIANCE * kelvin**4)[..., None]
    return DensityGrid((values * np.array(emission.color)).astype(np.float32), field.to_world)


def _coefficients(reading: Reading, prim: Usd.Prim) -> tuple[Color, Color]:
    """Return scattering and absorption: as given, or computed from the two colours."""
    names, physical = ("photonbeams:nearColor", "photonbeams:farColor"), ("scattering", "absorption")
    missing = [name for name in names if reading.value(prim, name) is None]
    if len(missing) == 2:
        return tuple(_attribute(reading, prim, name) for name in physical)
    if missing:
        other = next(name for name in names if name not in missing)
        raise reading.fail(prim, missing[0], f"is not given: expected a colour, to go with {other}")
    if any(prim.GetAttribute(f"photonbeams:{name}").HasAuthoredValue() for name in physical):
        reading.warn(prim, "and farColor make the fog: scattering and absorption are not used", names[0])
    near, far = (reading.color(prim, name, 0.0) for name in names)
    ratios = [last / first for first, last in zip(near, far, strict=True) if first > 0]
    if any(not DARKEST * (1 - 1e-5) <= ratio <= 1 + 1e-5 for ratio in ratios):
        text = (
            f"is {shown(far)}: expected {DARKEST:g} to {BRIGHTEST:g} of nearColor in each channel; the nearest is used"
        )
        reading.warn(prim, text, names[1])
    albedo, distance = (_attribute(reading, prim, name) for name in ("albedo", "farDistance"))
    try:
        return coefficients(near, far, albedo, distance)
    except SceneError as error:
        raise SceneError(f"{reading.place(prim)}: {error}") from None
