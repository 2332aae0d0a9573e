"""Read render settings and products (UsdRender): what a stage sets for its pictures."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from math import ceil, isfinite
from pathlib import Path
from typing import Any

from ..constants import CRYPTO, FILTERS, REQUESTED, layers_named
from ..images.frame import fractions_of, overscan_problem
from ..images.numbering import numbering_problem
from ..scene import MOST_PIXELS, SceneError
from ..scene.cameras import CONFORM_POLICIES
from .common.openusd import Usd, UsdGeom, UsdRender
from .common.reading import Reading, Time, file_of, is_relationship, target_paths
from .common.selection import settings_at
from .common.warnings import Warnings

SUFFIXES = (".exr", ".png")
# Names of other renderers' variables, in lower case.
_ALIASES = {
    **dict.fromkeys(("color", "beauty", "ci", "c", "rgb", "a", "alpha", "lpe:c.*", "lpe:c.*[lo]"), "rgba"),
    **dict.fromkeys(("z", "lineardepth"), "depth"),
    **dict.fromkeys(("n", "nn", "normals"), "normal"),
    **dict.fromkeys(("diffusealbedo", "diffuse_albedo"), "albedo"),
    **dict.fromkeys(("p", "pworld", "worldposition"), "position"),
    **dict.fromkeys(("motionvector", "motionvectors", "motion_vector"), "motion"),
    **dict.fromkeys(("cryptomatte", "cryptoobject", "crypto_primpath"), "crypto_object"),
    **dict.fromkeys(("cryptomaterial",), "crypto_material"),
    **dict.fromkeys(("volume", "volume_direct"), "beams"),
}
_LAYERS = ("rgba", "surface", "beams", "transmittance", "depth", *chain(*REQUESTED.values()))
_EDGE = 1e-4  # of a pixel: dataWindowNDC has single precision

#: The attribute of settings and products that names a pixel filter, by the names of Mitsuba's plug-ins.
PIXEL_FILTER = "photonbeams:pixelFilter"

#: The attribute of products that says whether all layers of a file are in one part.
SINGLE_PART = "photonbeams:singlePart"

_DEEP = "deepRaster"  # the type of a product

Window = tuple[float, float, float, float]


@dataclass(frozen=True)
class RenderProduct:
    """A RenderProduct: its prim's path, the layers that its orderedVars name, if any, and how an .exr holds them.

    `single_part`, from photonbeams:singlePart, says whether they are in one part, and `deep` whether it is a
    deepRaster: a deep picture of the beams.
    """

    path: str
    variables: tuple[str, ...] = ()
    single_part: bool = False
    deep: bool = False


@dataclass(frozen=True)
class RenderSettings:
    """The values of a RenderSettings prim and its products; None or the fallback where nothing is authored.

    Attributes
    ----------
    path
        The prim's path.
    camera, resolution
        Path of the camera, and (width, height) in pixels.
    data_window
        x0, y0, x1, y1 of the part to render, as fractions of the picture from the lower left; numbers below 0 and
        above 1 are overscan.
    pixel_aspect, conform
        A pixel's width over its height, and one of `scene.cameras.CONFORM_POLICIES`.
    disable_motion_blur, disable_depth_of_field
        Whether to render without motion blur, at the frame's own time (formerly instantaneousShutter), and without
        depth of field.
    pixel_filter
        One of `constants.FILTERS`, from photonbeams:pixelFilter.
    products
        The raster products.
    file
        The stage's file, for messages.
    """

    path: str | None = None
    camera: str | None = None
    resolution: tuple[int, int] | None = None
    data_window: Window | None = None
    pixel_aspect: float = 1.0
    conform: str = CONFORM_POLICIES[0]
    disable_motion_blur: bool | None = None
    disable_depth_of_field: bool | None = None
    pixel_filter: str | None = None
    products: tuple[RenderProduct, ...] = ()
    file: str = field(default="the stage", compare=False)

    def crop(self, width: int, height: int) -> Window | None:
        """Return the data window from the top left, snapped to the pixels whose centres it contains; at least one.

        Raises
        ------
        SceneError
            The window has more overscan than can be rendered.
        """
        if self.data_window is None:
            return None
        x0, y0, x1, y1 = self.data_window
        left, right = _pixels(x0, x1, width)
        top, bottom = _pixels(1 - y1, 1 - y0, height)
        found = (left, top, right, bottom)
        if problem := overscan_problem(found, width, height):
            raise SceneError(f"{self.file}: {self.path}.dataWindowNDC is {_shown(self.data_window)}: {problem}")
        return found


def _pixels(begin: float, end: float, count: int) -> tuple[float, float]:
    """Return the fractions of the edges around the pixels with centres from `begin` to `end`."""
    first, last = (ceil(each * count - 0.5 - _EDGE) for each in (begin, end))
    if last <= first:  # no pixel's centre is inside
        first = min(max(first, 0), count - 1)
    return fractions_of(first, max(last, first + 1), count)


def read_settings(
    stage: Usd.Stage, path: str | None = None, given: Collection[str] = (), warnings: Warnings | None = None
) -> RenderSettings:
    """Return the render settings at a path, or those that the stage's metadata names, or else empty ones.

    Parameters
    ----------
    stage, path
        The stage, and the path of the settings or None.
    given
        Names of what is given otherwise, such as "camera", "resolution" or "products": these are not read, so errors in
        them do not matter.
    warnings
        The same as for `read_scene`.

    Raises
    ------
    SceneError
        There are no settings at that path, a product is not one, or values make no picture.
    """
    reading = Reading(stage, warnings=warnings or Warnings())
    settings = _settings(reading, path)
    if settings is None:
        return RenderSettings()
    prim = settings.GetPrim()
    rasters = [] if "products" in given else _rasters(reading, prim)
    values: dict[str, Any] = {}
    for name, read in _READERS.items():
        agreed = partial(_agreed, reading, prim, rasters, name, read)
        if name in given:
            values[name] = None
        elif name in _SIZES:
            values[name] = agreed()
        else:
            values[name] = reading.attempt(prim, agreed, None, "it is ignored")
    conform = values["aspectRatioConformPolicy"] or CONFORM_POLICIES[0]
    instantaneous = values.pop("instantaneousShutter")
    still = values["disableMotionBlur"] if instantaneous is None else instantaneous or bool(values["disableMotionBlur"])
    return RenderSettings(
        path=str(prim.GetPath()),
        camera=values["camera"],
        resolution=values["resolution"],
        data_window=values["dataWindowNDC"],
        # The policy that adjusts the ratio disregards its value.
        pixel_aspect=1.0 if conform == "adjustPixelAspectRatio" else values["pixelAspectRatio"] or 1.0,
        conform=conform,
        disable_motion_blur=still,
        disable_depth_of_field=values["disableDepthOfField"],
        pixel_filter=values[PIXEL_FILTER],
        products=tuple(_product(reading, raster) for raster in rasters),
        file=file_of(stage),
    )


def _product(reading: Reading, raster: Usd.Prim) -> RenderProduct:
    single_part = reading.attempt(raster, partial(_flag(SINGLE_PART), reading, raster), False, "it is ignored")
    deep = str(reading.value(raster, "productType", "raster")) == _DEEP
    return RenderProduct(str(raster.GetPath()), () if deep else _variables(reading, raster), bool(single_part), deep)


def product_file(stage: Usd.Stage, product: RenderProduct, time: Time = None) -> Path:
    """Return the file that a product names at a time, because names may be animated.

    Raises
    ------
    SceneError
        The product names no file, or one that is not a picture.
    """
    reading = Reading(stage, time)
    prim = stage.GetPrimAtPath(product.path)
    name = str(reading.value(prim, "productName", ""))
    if Path(name.lower()).suffix not in SUFFIXES:
        raise reading.fail(prim, "productName", f"is '{name}': expected a name that ends in {' or '.join(SUFFIXES)}")
    if problem := numbering_problem(Path(name)):
        raise reading.fail(prim, "productName", f"is '{name}': {problem}")
    return Path(name)


def _settings(reading: Reading, path: str | None) -> UsdRender.Settings | None:
    stage = reading.stage
    settings = settings_at(stage, path)
    if path is None:
        if settings is None and (named := stage.GetMetadata("renderSettingsPrimPath")):
            text = f"renderSettingsPrimPath is {named}, which is not a RenderSettings prim: it is ignored"
            reading.warnings.give(text, file_of(stage))
    elif settings is None:
        names = [str(prim.GetPath()) for prim in stage.Traverse() if prim.IsA(UsdRender.Settings)]
        expected = f"one of {', '.join(names)}" if names else "a RenderSettings prim"
        raise SceneError(f"{file_of(stage)} has no render settings '{path}': expected {expected}")
    return settings


def _rasters(reading: Reading, settings: Usd.Prim) -> list[Usd.Prim]:
    """Return the products of settings that can be rendered."""
    rasters = []
    for prim in reading.targets(settings, "products"):
        if not prim.IsA(UsdRender.Product):
            raise reading.fail(settings, "products", f"names {prim.GetPath()}: expected a RenderProduct")
        rasters.append(prim)
    return rasters


def _agreed(
    reading: Reading, settings: Usd.Prim, products: list[Usd.Prim], name: str,
    read: Callable[[Reading, Usd.Prim], object],
) -> Any:  # fmt: skip
    """Return the value of the first product, or else of the settings.

    A product's value is stronger than that of its settings. Warn about products that differ from the first, because
    only one picture is rendered.
    """
    own = read(reading, settings) if _authored(settings, name) else None
    values = [read(reading, prim) if _authored(prim, name) else own for prim in products] or [own]
    for prim, value in zip(products, values, strict=False):
        if value != values[0]:
            reading.warn(prim, f"differs from that of {products[0].GetPath()}, which is used for all products", name)
    return values[0]


def _authored(prim: Usd.Prim, name: str) -> bool:
    if name == "camera":
        return bool(target_paths(prim, name)) or not is_relationship(prim, name)
    attribute = prim.GetAttribute(name)
    return bool(attribute and attribute.HasAuthoredValue())


def _camera(reading: Reading, prim: Usd.Prim) -> str:
    camera = reading.targets(prim, "camera")[0]
    if not camera.IsA(UsdGeom.Camera):
        raise reading.fail(prim, "camera", f"names {camera.GetPath()}: expected a Camera")
    return str(camera.GetPath())


def _resolution(reading: Reading, prim: Usd.Prim) -> tuple[int, int]:
    width, height = reading.vector(prim, "resolution", (0, 0))
    if not (1 <= width <= MOST_PIXELS and 1 <= height <= MOST_PIXELS):
        raise reading.fail(
            prim, "resolution", f"is {width:g} x {height:g}: expected 1 to {MOST_PIXELS} pixels each way"
        )
    return int(width), int(height)


def _pixel_aspect_ratio(reading: Reading, prim: Usd.Prim) -> float:
    ratio = reading.number(prim, "pixelAspectRatio", 1.0)
    if not 1e-3 <= ratio <= 1e3:
        raise reading.fail(prim, "pixelAspectRatio", f"is {ratio:g}: expected a number from 0.001 to 1000")
    return ratio


def _data_window(reading: Reading, prim: Usd.Prim) -> Window:
    x0, y0, x1, y1 = window = reading.vector(prim, "dataWindowNDC", (0.0, 0.0, 1.0, 1.0))
    if not (all(map(isfinite, window)) and max(x0, 0) < min(x1, 1) and max(y0, 0) < min(y1, 1)):
        text = f"is {_shown(window)}: expected x0 < x1 and y0 < y1, overlapping the picture"
        raise reading.fail(prim, "dataWindowNDC", text)
    return x0, y0, x1, y1


def _shown(window: Sequence[float]) -> str:
    """Return a window as a stage writes it."""
    return f"({', '.join(f'{each:g}' for each in window)})"


def _choice(name: str, choices: Collection[str]) -> Callable[[Reading, Usd.Prim], str]:
    return lambda reading, prim: reading.choice(prim, name, None, choices)


def _flag(name: str) -> Callable[[Reading, Usd.Prim], bool]:
    return lambda reading, prim: reading.flag(prim, name, False)


_READERS: dict[str, Callable[[Reading, Usd.Prim], Any]] = {
    "camera": _camera,
    "resolution": _resolution,
    "pixelAspectRatio": _pixel_aspect_ratio,
    "aspectRatioConformPolicy": _choice("aspectRatioConformPolicy", CONFORM_POLICIES),
    "dataWindowNDC": _data_window,
    "instantaneousShutter": _flag("instantaneousShutter"),
    "disableMotionBlur": _flag("disableMotionBlur"),
    "disableDepthOfField": _flag("disableDepthOfField"),
    PIXEL_FILTER: _choice(PIXEL_FILTER, FILTERS),
}

# What cannot be ignored: the picture would have another size.
_SIZES = ("resolution", "dataWindowNDC")


def _variables(reading: Reading, product: Usd.Prim) -> tuple[str, ...]:
    """Return the layers of a product's variables, by their sourceName or else by their prims' names."""
    names = []
    for path in target_paths(product, "orderedVars"):
        prim = reading.stage.GetPrimAtPath(path)
        if not prim or not prim.IsA(UsdRender.Var):
            reading.warn(product, f"names {path}: expected a RenderVar; it is left out", "orderedVars")
            continue
        name = str(reading.value(prim, "sourceName", "")) or prim.GetName()
        kind = str(reading.value(prim, "sourceType", "raw"))
        name = _ALIASES.get((name if kind == "raw" else f"{kind}:{name}").lower(), name if kind == "raw" else "")
        if not name:
            text = f"is '{kind}': it is left out, because only layers are written, such as beams or depth"
            reading.warn(prim, text, "sourceType")
            continue
        plain = name.lower() in _LAYERS or name.lower().startswith(CRYPTO)
        names.append(name.lower() if plain else name)
    return tuple(dict.fromkeys(layer for name in names for layer in layers_named(name)))
