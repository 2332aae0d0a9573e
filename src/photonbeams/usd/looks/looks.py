"""Read `PhotonBeamsLook` prims as plain numbers: a LookSpec, from which a look is built."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ...scene import Array, Color, SceneError, color, rgb
from ..common.openusd import Usd
from ..common.reading import Reading
from ..common.textures import read_image

_FALLOFFS = ("physical", "none", "exponential", "power", "polynomial")
_INTERPOLATIONS = {
    "none": "none",
    "linear": "linear",
    "smooth": "smooth",
    "catmullRom": "catmull-rom",
    "monotone": "monotone",
}
_PROFILES = ("constant", "epanechnikov", "biweight", "gaussian", "smoothstep", "hollow", "tabulated")


@dataclass(frozen=True)
class Span:
    """Where a ramp, texture or polynomial begins and ends: fractions of the beam, or scene units along it."""

    space: str = "fraction"  # fraction | distance
    begin: float = 0.0
    end: float = 1.0


@dataclass(frozen=True)
class CurveSpec:
    """A part that every factor may have: the product of a ramp, a texture and an expression, if set.

    Attributes
    ----------
    knots, colors, interpolation
        A ramp, (M,) and (M, 3), without knots for none; the interpolation is named as in `looks.ColorRamp`.
    texture
        Colours (M, 3) from begin to end, or None.
    span
        Where ramp and texture begin and end.
    expression
        An expression (`looks.expression`), or "".
    """

    knots: tuple[float, ...] = ()
    colors: tuple[Color, ...] = ()
    interpolation: str = "linear"
    texture: Array | None = None
    span: Span = Span()
    expression: str = ""


@dataclass(frozen=True)
class AlongSpec:
    """The colour along the beam: the product of everything that is set.

    Attributes
    ----------
    falloff, length, exponent, coefficients
        "physical", "none", "exponential" (length), "power" (length, exponent) or "polynomial" (coefficients).
    physical
        Whether to multiply by the medium's attenuation, too; no effect if the falloff is physical already.
    tint
        A constant colour.
    inner, outer, fade
        Distances between which the beam fades out, and the interpolation; outer 0: it does not fade.
    curve
        Ramp, texture and expression; its span applies to the polynomial, too.
    """

    falloff: str = "physical"
    length: float = 1.0
    exponent: float = 2.0
    coefficients: tuple[float, ...] = ()
    physical: bool = True
    tint: Color = (1.0, 1.0, 1.0)
    inner: float = 0.0
    outer: float = 0.0
    fade: str = "smooth"
    curve: CurveSpec = CurveSpec()


@dataclass(frozen=True)
class AcrossSpec:
    """The profile, and its curve, whose ramp and texture run from the axis to the rim.

    `width` applies to the Gaussian profile, `hardness` to the smoothstep, `inner` and `softness` to the hollow, and
    `values` to the tabulated one.
    """

    profile: str = "epanechnikov"
    width: float = 0.35
    hardness: float = 0.0
    inner: float = 0.5
    softness: float = 1.0
    values: tuple[float, ...] = ()
    curve: CurveSpec = CurveSpec()


@dataclass(frozen=True)
class EyeSpec:
    """The change toward the camera: "physical", "none" or "exponential" with `length`; the curve is over distance."""

    falloff: str = "physical"
    length: float = 1.0
    curve: CurveSpec = CurveSpec()


@dataclass(frozen=True)
class AngleSpec:
    """The view-angle shading: "physical", "constant" (isotropic) or "glow" with `anisotropy`, `mix` and `gain`.

    The curve is over degrees: 0 looks straight into the light.
    """

    shading: str = "physical"
    anisotropy: float = 0.8
    mix: float = 0.5
    gain: float = 1.0
    curve: CurveSpec = CurveSpec()


@dataclass(frozen=True)
class NoiseSpec:
    """Dust and wisps; see `looks.Noise`."""

    amount: float = 0.0
    scale: float = 1.0
    octaves: int = 4
    contrast: float = 2.0
    drift: Color = (0.0, 0.0, 0.0)
    evolution: float = 0.0
    space: str = "world"


@dataclass(frozen=True)
class LookSpec:
    """A checked look in plain numbers. `name` is the prim's path, `variation` how much beams differ in brightness."""

    name: str
    along: AlongSpec = AlongSpec()
    across: AcrossSpec = AcrossSpec()
    eye: EyeSpec = EyeSpec()
    angle: AngleSpec = AngleSpec()
    noise: NoiseSpec = NoiseSpec()
    variation: float = 0.0


def read_look(reading: Reading, user: Usd.Prim, prim: Usd.Prim) -> LookSpec:
    """Return the look of a `PhotonBeamsLook` prim, which `user` (a light or curves) names.

    Raises
    ------
    SceneError
        The prim has another type, knots do not ascend, numbers are not finite or out of range, lists do not agree in
        length, or a texture cannot be read.
    """
    if prim.GetTypeName() != "PhotonBeamsLook":
        kind = prim.GetTypeName() or "prim without a type"
        text = f"names {prim.GetPath()}, a {kind}: expected a PhotonBeamsLook"
        raise reading.fail(user, "photonbeams:look", text)
    key = ("look", prim.GetPath())
    if key not in reading.cache:
        source = _LookAttributes(reading, prim)
        _warn_of_unknown(source)
        reading.cache[key] = LookSpec(
            str(prim.GetPath()), _along(source), _across(source), _eye(source), _angle(source), _noise(source),
            source.number("variation", LookSpec.variation, 0.0, 1.0),
        )  # fmt: skip
    return reading.cache[key]


@dataclass(frozen=True)
class _LookAttributes:
    """The attributes of a look, named without their common prefix."""

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


def _warn_of_unknown(source: _LookAttributes) -> None:
    definition = Usd.SchemaRegistry().FindConcretePrimDefinition("PhotonBeamsLook")
    if not definition:  # the schemas were registered after OpenUSD looked for them, see schemas.register
        return
    known = set(definition.GetPropertyNames())
    for name in source.prim.GetAuthoredPropertyNames():
        if name.startswith("photonbeams:") and name not in known:
            source.reading.warn_of_unknown(source.prim, str(name), known)


def _along(source: _LookAttributes) -> AlongSpec:
    falloff = source.choice("along:falloff", AlongSpec.falloff, _FALLOFFS)
    coefficients = source.numbers("along:coefficients")
    if falloff == "polynomial" and not coefficients:
        raise source.fail("along:coefficients", "is empty: a polynomial falloff expects its coefficients")
    inner = source.number("along:inner", AlongSpec.inner, minimum=0.0)
    outer = source.number("along:outer", AlongSpec.outer, minimum=0.0)
    if outer > 0 and outer <= inner:
        raise source.fail("along:outer", f"is {outer:g}: expected more than along:inner, {inner:g}, or 0")
    return AlongSpec(
        falloff=falloff,
        length=source.positive("along:length", AlongSpec.length),
        exponent=source.number("along:exponent", AlongSpec.exponent, minimum=0.0),
        coefficients=coefficients,
        physical=source.reading.flag(source.prim, "photonbeams:along:physical", AlongSpec.physical),
        tint=source.reading.color(source.prim, "photonbeams:along:tint", AlongSpec.tint),
        inner=inner,
        outer=outer,
        fade=_INTERPOLATIONS[source.choice("along:fade", AlongSpec.fade, _INTERPOLATIONS)],
        curve=_curve(source, "along", _span(source)),
    )


def _curve(source: _LookAttributes, slot: str, span: Span) -> CurveSpec:
    """Return the ramp, texture and expression that are set for a factor."""
    knots, colors = source.numbers(f"{slot}:ramp:knots"), source.colors(f"{slot}:ramp:colors")
    if len(knots) != len(colors):
        text = f"has {len(knots)} values but {slot}:ramp:colors has {len(colors)}: expected as many of each"
        raise source.fail(f"{slot}:ramp:knots", text)
    if any(b <= a for a, b in pairwise(knots)):
        raise source.fail(f"{slot}:ramp:knots", f"is {list(knots)}: expected ascending positions")
    interpolation = source.choice(f"{slot}:ramp:interpolation", CurveSpec.interpolation, _INTERPOLATIONS)
    expression = str(source.reading.value(source.prim, f"photonbeams:{slot}:expression", CurveSpec.expression)).strip()
    if expression:
        try:
            from ...looks.expression import parse  # starts Dr.Jit

            parse(expression)
        except ValueError as error:
            raise source.fail(f"{slot}:expression", f"is wrong: {error}") from None
    return CurveSpec(knots, colors, _INTERPOLATIONS[interpolation], _texture(source, slot), span, expression)


def _noise(source: _LookAttributes) -> NoiseSpec:
    octaves = source.reading.value(source.prim, "photonbeams:noise:octaves", NoiseSpec.octaves)
    if not (isinstance(octaves, int) and 1 <= octaves <= 8):
        raise source.fail("noise:octaves", f"is {octaves}: expected a whole number from 1 to 8")
    drift = source.reading.array(source.prim, "photonbeams:noise:drift", 1)
    numbers = NoiseSpec.drift if drift is None else tuple(float(x) for x in drift[:, 0])
    if len(numbers) != 3:
        raise source.fail("noise:drift", f"has {len(numbers)} values: expected three")
    return NoiseSpec(
        amount=source.number("noise:amount", NoiseSpec.amount, 0.0, 1.0),
        scale=source.positive("noise:scale", NoiseSpec.scale),
        octaves=octaves,
        contrast=source.number("noise:contrast", NoiseSpec.contrast, 0.0, 100.0),
        drift=numbers,  # type: ignore[arg-type]
        evolution=source.number("noise:evolution", NoiseSpec.evolution),
        space=source.choice("noise:space", NoiseSpec.space, ("world", "light")),
    )


def _span(source: _LookAttributes) -> Span:
    space = source.choice("along:space", Span.space, ("fraction", "distance"))
    begin, end = source.number("along:begin", Span.begin), source.number("along:end", Span.end)
    if end <= begin:
        raise source.fail("along:end", f"is {end:g}: expected more than along:begin, {begin:g}")
    return Span(space, begin, end)


def _texture(source: _LookAttributes, slot: str) -> Array | None:
    name = f"{slot}:texture"
    pixels = read_image(source.reading, source.prim, f"photonbeams:{name}")
    if pixels is None:
        return None
    row = rgb(pixels.mean(axis=0, dtype=np.float64))  # a 1D texture may be several pixels high
    if np.any(row < 0):
        raise source.fail(name, "has negative pixels: expected colours of 0 or more")
    return row


def _across(source: _LookAttributes) -> AcrossSpec:
    profile = source.choice("across:profile", AcrossSpec.profile, _PROFILES)
    values = source.numbers("across:values")
    if profile == "tabulated" and (len(values) < 2 or min(values) < 0 or max(values) == 0):
        text = f"is {list(values)}: a tabulated profile expects two values or more, none negative and not all 0"
        raise source.fail("across:values", text)
    return AcrossSpec(
        profile=profile,
        width=source.number("across:width", AcrossSpec.width, 0.02, 10.0),
        hardness=source.number("across:hardness", AcrossSpec.hardness, 0.0, 1.0),
        inner=source.number("across:inner", AcrossSpec.inner, 0.0, 0.99),
        softness=source.number("across:softness", AcrossSpec.softness, 0.01, 1.0),
        values=values,
        curve=_curve(source, "across", Span("radius", 0.0, 1.0)),
    )


def _eye(source: _LookAttributes) -> EyeSpec:
    falloff = source.choice("eye:falloff", EyeSpec.falloff, ("physical", "none", "exponential"))
    span = Span("distance", source.number("eye:begin", Span.begin), source.number("eye:end", Span.end))
    if span.end <= span.begin:
        raise source.fail("eye:end", f"is {span.end:g}: expected more than eye:begin, {span.begin:g}")
    return EyeSpec(falloff, source.positive("eye:length", EyeSpec.length), _curve(source, "eye", span))


def _angle(source: _LookAttributes) -> AngleSpec:
    return AngleSpec(
        shading=source.choice("angle:shading", AngleSpec.shading, ("physical", "constant", "glow")),
        anisotropy=source.number("angle:anisotropy", AngleSpec.anisotropy, -0.99, 0.99),
        mix=source.number("angle:mix", AngleSpec.mix, 0.0, 1.0),
        gain=source.number("angle:gain", AngleSpec.gain, minimum=0.0),
        curve=_curve(source, "angle", Span("angle", 0.0, 180.0)),
    )
