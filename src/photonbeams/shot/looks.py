"""`PhotonBeamsLook` prims as plain numbers: a LookSpec, from which a look is built."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Usd

from ..scene import Array, Color, SceneError, color
from .reading import Reading
from .textures import read_image

if TYPE_CHECKING:
    from ..looks import Look

_FALLOFFS = ("physical", "none", "exponential", "power", "polynomial")
_INTERPOLATIONS = {
    "none": "none",
    "linear": "linear",
    "smooth": "smooth",
    "catmullRom": "catmull-rom",
    "monotone": "monotone",
}
_PROFILES = ("constant", "epanechnikov", "biweight", "gaussian", "smoothstep", "tabulated")


@dataclass(frozen=True)
class Span:
    """Where a ramp, texture or polynomial has its 0 and 1: fractions of the beam, or scene units along it."""

    space: str = "fraction"  # fraction | distance
    begin: float = 0.0
    end: float = 1.0


@dataclass(frozen=True)
class AlongSpec:
    """The colour along the beam: the product of everything that is set.

    Attributes
    ----------
    falloff, length, exponent, coefficients
        "physical", "none", "exponential" (length), "power" (length, exponent) or "polynomial" (coefficients).
    physical
        Multiply by the medium's attenuation too; of no matter where the falloff is physical already.
    tint
        A constant colour.
    knots, colors, interpolation
        A ramp, (M,) and (M, 3), or no knots for none; names as `looks.ColorRamp` has them.
    texture
        Colours (M, 3) from begin to end, or None.
    span
        For ramp, texture and polynomial.
    """

    falloff: str = "physical"
    length: float = 1.0
    exponent: float = 2.0
    coefficients: tuple[float, ...] = ()
    physical: bool = True
    tint: Color = (1.0, 1.0, 1.0)
    knots: tuple[float, ...] = ()
    colors: tuple[Color, ...] = ()
    interpolation: str = "linear"
    texture: Array | None = None
    span: Span = Span()


@dataclass(frozen=True)
class AcrossSpec:
    """The profile: its name, `width` of the Gaussian, `hardness` of the smoothstep, `values` of the table."""

    profile: str = "epanechnikov"
    width: float = 0.35
    hardness: float = 0.0
    values: tuple[float, ...] = ()


@dataclass(frozen=True)
class EyeSpec:
    """The change toward the camera: "physical", "none" or "exponential" with its `length`."""

    falloff: str = "physical"
    length: float = 1.0


@dataclass(frozen=True)
class AngleSpec:
    """The view-angle shading: "physical", "constant" (isotropic) or "glow" with `anisotropy`, `mix` and `gain`."""

    shading: str = "physical"
    anisotropy: float = 0.8
    mix: float = 0.5
    gain: float = 1.0


@dataclass(frozen=True)
class LookSpec:
    """A look in plain numbers, checked. `name` is the prim's path."""

    name: str
    along: AlongSpec = AlongSpec()
    across: AcrossSpec = AcrossSpec()
    eye: EyeSpec = EyeSpec()
    angle: AngleSpec = AngleSpec()


def read_look(reading: Reading, user: Usd.Prim, prim: Usd.Prim) -> LookSpec:
    """Return the look of a `PhotonBeamsLook` prim, that `user` (a light, curves) names.

    Raises
    ------
    SceneError
        A prim of another type; knots that do not ascend, numbers that are not finite or out of range, lists that do
        not agree in length, a texture that cannot be read.
    """
    if prim.GetTypeName() != "PhotonBeamsLook":
        kind = prim.GetTypeName() or "prim without a type"
        text = f"names {prim.GetPath()}, a {kind}: expected a PhotonBeamsLook"
        raise reading.fail(user, "photonbeams:look", text)
    key = ("look", prim.GetPath())
    if key not in reading.cache:
        source = _Source(reading, prim)
        _warn_of_unknown(source)
        reading.cache[key] = LookSpec(
            str(prim.GetPath()), _along(source), _across(source), _eye(source), _angle(source)
        )
    return reading.cache[key]


@dataclass(frozen=True)
class _Source:
    """A look's attributes, without their common prefix."""

    reading: Reading
    prim: Usd.Prim

    def number(self, name: str, default: float, minimum: float = -np.inf, maximum: float = np.inf) -> float:
        return self.reading.number(self.prim, f"photonbeams:{name}", default, minimum, maximum)

    def positive(self, name: str, default: float) -> float:
        value = self.number(name, default, minimum=0.0)
        if value == 0:
            raise self.fail(name, "is 0: expected a positive number")
        return value

    def choice(self, name: str, default: str, choices: Any) -> str:
        value = str(self.reading.value(self.prim, f"photonbeams:{name}", default))
        if value not in choices:
            raise self.fail(name, f"is '{value}': expected one of {', '.join(choices)}")
        return value

    def numbers(self, name: str) -> tuple[float, ...]:
        values = self.reading.array(self.prim, f"photonbeams:{name}", 1)
        return () if values is None else tuple(values[:, 0].tolist())

    def colors(self, name: str) -> tuple[Color, ...]:
        values = self.reading.array(self.prim, f"photonbeams:{name}", 3)
        if values is None:
            return ()
        place = self.reading.place(self.prim, f"photonbeams:{name}")
        return tuple(color(each, f"{place}[{index}]") for index, each in enumerate(values))

    def fail(self, name: str, text: str) -> SceneError:
        return self.reading.fail(self.prim, f"photonbeams:{name}", text)


def _warn_of_unknown(source: _Source) -> None:
    definition = Usd.SchemaRegistry().FindConcretePrimDefinition("PhotonBeamsLook")
    if not definition:  # schemas that were registered after OpenUSD looked for them, see schemas.register
        return
    known = set(definition.GetPropertyNames())
    for name in source.prim.GetAuthoredPropertyNames():
        if name.startswith("photonbeams:") and name not in known:
            source.reading.warn(source.prim, "is no attribute of a PhotonBeamsLook: it is ignored", str(name))


def _along(source: _Source) -> AlongSpec:
    falloff = source.choice("along:falloff", "physical", _FALLOFFS)
    coefficients = source.numbers("along:coefficients")
    if falloff == "polynomial" and not coefficients:
        raise source.fail("along:coefficients", "is empty: a polynomial falloff expects its coefficients")
    knots, colors = source.numbers("along:ramp:knots"), source.colors("along:ramp:colors")
    if len(knots) != len(colors):
        text = f"has {len(knots)} values and along:ramp:colors {len(colors)}: expected as many of each"
        raise source.fail("along:ramp:knots", text)
    if any(b <= a for a, b in pairwise(knots)):
        raise source.fail("along:ramp:knots", f"is {list(knots)}: expected positions that ascend")
    interpolation = source.choice("along:ramp:interpolation", "linear", _INTERPOLATIONS)
    return AlongSpec(
        falloff=falloff,
        length=source.positive("along:length", 1.0),
        exponent=source.number("along:exponent", 2.0, minimum=0.0),
        coefficients=coefficients,
        physical=source.reading.flag(source.prim, "photonbeams:along:physical", True),
        tint=source.reading.color(source.prim, "photonbeams:along:tint", (1, 1, 1)),
        knots=knots,
        colors=colors,
        interpolation=_INTERPOLATIONS[interpolation],
        texture=_texture(source),
        span=_span(source),
    )


def _span(source: _Source) -> Span:
    space = source.choice("along:space", "fraction", ("fraction", "distance"))
    begin, end = source.number("along:begin", 0.0), source.number("along:end", 1.0)
    if end <= begin:
        raise source.fail("along:end", f"is {end:g}: expected more than along:begin, {begin:g}")
    return Span(space, begin, end)


def _texture(source: _Source) -> Array | None:
    pixels = read_image(source.reading, source.prim, "photonbeams:along:texture")
    if pixels is None:
        return None
    row = pixels.mean(axis=0, dtype=np.float64)  # a 1D texture may be painted several pixels high
    row = row[:, :3] if row.shape[1] >= 3 else np.repeat(row[:, :1], 3, axis=1)
    if np.any(row < 0):
        raise source.fail("along:texture", "has negative pixels: expected colours of at least 0")
    return row


def _across(source: _Source) -> AcrossSpec:
    profile = source.choice("across:profile", "epanechnikov", _PROFILES)
    values = source.numbers("across:values")
    if profile == "tabulated" and (len(values) < 2 or min(values) < 0 or max(values) == 0):
        text = f"is {list(values)}: a tabulated profile expects two values or more, none negative and not all 0"
        raise source.fail("across:values", text)
    return AcrossSpec(
        profile=profile,
        width=source.number("across:width", 0.35, 0.02, 10.0),
        hardness=source.number("across:hardness", 0.0, 0.0, 1.0),
        values=values,
    )


def _eye(source: _Source) -> EyeSpec:
    falloff = source.choice("eye:falloff", "physical", ("physical", "none", "exponential"))
    return EyeSpec(falloff, source.positive("eye:length", 1.0))


def _angle(source: _Source) -> AngleSpec:
    return AngleSpec(
        shading=source.choice("angle:shading", "physical", ("physical", "constant", "glow")),
        anisotropy=source.number("angle:anisotropy", 0.8, -0.99, 0.99),
        mix=source.number("angle:mix", 0.5, 0.0, 1.0),
        gain=source.number("angle:gain", 1.0, minimum=0.0),
    )


def build_look(spec: LookSpec) -> Look:
    """Return the look that a LookSpec describes."""
    from .. import looks  # starts Dr.Jit, which readers do not need

    along, eye, angle = spec.along, spec.eye, spec.angle
    span = {"space": along.span.space, "begin": along.span.begin, "end": along.span.end}
    parts: list[looks.Factor] = []
    if along.falloff == "exponential":
        parts.append(looks.Exponential(along.length))
    elif along.falloff == "power":
        parts.append(looks.Power(along.exponent, along.length))
    elif along.falloff == "polynomial":
        parts.append(looks.Polynomial(along.coefficients, **span))  # type: ignore[arg-type]
    if along.knots:
        parts.append(looks.ColorRamp(along.knots, along.colors, along.interpolation, **span))  # type: ignore[arg-type]
    if along.texture is not None:
        parts.append(looks.Texture(along.texture, **span))  # type: ignore[arg-type]
    if along.physical:
        parts.append(looks.Attenuation())
    if along.tint != (1.0, 1.0, 1.0) or not parts:
        parts.append(looks.Constant(along.tint))
    profile = {
        "constant": looks.Uniform,
        "epanechnikov": looks.Epanechnikov,
        "biweight": looks.Biweight,
        "gaussian": lambda: looks.Gaussian(spec.across.width),
        "smoothstep": lambda: looks.Smoothstep(spec.across.hardness),
        "tabulated": lambda: looks.Tabulated(spec.across.values),
    }[spec.across.profile]
    toward = {
        "physical": looks.Attenuation,
        "none": lambda: looks.Constant(1.0),
        "exponential": lambda: looks.Exponential(eye.length),
    }[eye.falloff]
    shading = {
        "physical": looks.Scattering,
        "constant": looks.Isotropic,
        "glow": lambda: looks.Glow(angle.anisotropy, angle.mix, angle.gain),
    }[angle.shading]
    return looks.Look(along=looks.Product(tuple(parts)), across=profile(), eye=toward(), angle=shading())
