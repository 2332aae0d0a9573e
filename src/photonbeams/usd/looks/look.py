"""Read `PhotonBeamsLook` prims as plain numbers: a LookSpec, from which a look is built."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ...scene import Array, Color, rgb
from ..common.definitions import LOOK, PREFIX, PrimRecord, definitions, read_record
from ..common.openusd import Usd
from ..common.reading import Reading


def _row(pixels: Array) -> Array:
    """Return a 1D texture, which may be several pixels high, as colours (M, 3)."""
    return rgb(pixels.mean(axis=0, dtype=np.float64))


@dataclass(frozen=True)
class Span(PrimRecord):
    """Where a ramp, texture or polynomial begins and ends: fractions of the beam, or scene units along it."""

    space: str = "fraction"  # fraction | distance; radius and angle where a stage has no choice
    begin: float = 0.0
    end: float = 1.0

    def problems(self) -> Iterator[tuple[str, str]]:
        """Return whether the end is before the beginning."""
        if self.end <= self.begin:
            yield "end", f"is {self.end:g}: expected more than begin, {self.begin:g}"


@dataclass(frozen=True)
class CurveSpec(PrimRecord):
    """A part that every factor may have: the product of a ramp, a texture and an expression, if set.

    A ramp has knots (M,) and colours (M, 3), without knots for none. A texture has colours (M, 3) from begin to end.
    """

    knots: tuple[float, ...] = field(default=(), metadata={"name": "ramp:knots"})
    colors: tuple[Color, ...] = field(default=(), metadata={"name": "ramp:colors"})
    interpolation: str = field(default="linear", metadata={"name": "ramp:interpolation"})
    texture: Array | None = field(default=None, metadata={"convert": _row})
    span: Span = field(default=Span(), metadata={"name": ""})
    expression: str = ""

    def problems(self) -> Iterator[tuple[str, str]]:
        """Return knots that do not ascend or lack colours, and what is wrong with the texture and the expression."""
        if len(self.knots) != len(self.colors):
            text = f"has {len(self.knots)} values but ramp:colors has {len(self.colors)}: expected as many of each"
            yield "ramp:knots", text
        if any(b <= a for a, b in pairwise(self.knots)):
            yield "ramp:knots", f"is {list(self.knots)}: expected ascending positions"
        if self.texture is not None and np.any(self.texture < 0):
            yield "texture", "has negative pixels: expected colours of 0 or more"
        if self.expression:
            try:
                from ...looks.expression import parse  # starts Dr.Jit

                parse(self.expression)
            except ValueError as error:
                yield "expression", f"is wrong: {error}"


@dataclass(frozen=True)
class AlongSpec(PrimRecord):
    """The colour along the beam: the product of everything that is set; the span applies to the polynomial, too."""

    falloff: str = "physical"
    length: float = 1.0
    exponent: float = 2.0
    coefficients: tuple[float, ...] = ()
    physical: bool = True
    tint: Color = (1.0, 1.0, 1.0)
    inner: float = 0.0
    outer: float = 0.0
    fade: str = "smooth"
    curve: CurveSpec = field(default=CurveSpec(), metadata={"name": ""})

    def problems(self) -> Iterator[tuple[str, str]]:
        """Return a polynomial without coefficients, and a fade that ends before it begins."""
        if self.falloff == "polynomial" and not self.coefficients:
            yield "coefficients", "is empty: a polynomial falloff expects its coefficients"
        if 0 < self.outer <= self.inner:
            yield "outer", f"is {self.outer:g}: expected more than inner, {self.inner:g}, or 0"


@dataclass(frozen=True)
class AcrossSpec(PrimRecord):
    """The profile, and its curve, whose ramp and texture run from the axis to the rim."""

    profile: str = "epanechnikov"
    width: float = 0.35
    hardness: float = 0.0
    inner: float = 0.5
    softness: float = 1.0
    values: tuple[float, ...] = ()
    curve: CurveSpec = field(default=CurveSpec(span=Span("radius")), metadata={"name": ""})

    def problems(self) -> Iterator[tuple[str, str]]:
        """Return values that are no profile."""
        values = self.values
        if self.profile == "tabulated" and (len(values) < 2 or min(values) < 0 or max(values) == 0):
            text = f"is {list(values)}: a tabulated profile expects two values or more, none negative and not all 0"
            yield "values", text


@dataclass(frozen=True)
class EyeSpec(PrimRecord):
    """The change toward the camera; the curve is over distance."""

    falloff: str = "physical"
    length: float = 1.0
    curve: CurveSpec = field(default=CurveSpec(span=Span("distance")), metadata={"name": ""})


@dataclass(frozen=True)
class AngleSpec(PrimRecord):
    """The view-angle shading; the curve is over degrees: 0 looks straight into the light."""

    shading: str = "physical"
    anisotropy: float = 0.8
    mix: float = 0.5
    gain: float = 1.0
    curve: CurveSpec = field(default=CurveSpec(span=Span("angle", 0.0, 180.0)), metadata={"name": ""})


@dataclass(frozen=True)
class NoiseSpec(PrimRecord):
    """Dust and wisps; see `looks.Noise`."""

    amount: float = 0.0
    scale: float = 1.0
    octaves: int = 4
    contrast: float = 2.0
    drift: Color = (0.0, 0.0, 0.0)
    evolution: float = 0.0
    space: str = "world"


@dataclass(frozen=True)
class LookSpec(PrimRecord):
    """A checked look in plain numbers: the attributes of a `PhotonBeamsLook`, and the prim's path as its `name`.

    The schema says what each attribute means. Its fallbacks are the defaults here; a test compares them.
    """

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
        The prim has another type, or an attribute cannot be used.
    """
    if prim.GetTypeName() != LOOK:
        kind = prim.GetTypeName() or "prim without a type"
        text = f"names {prim.GetPath()}, a {kind}: expected a {LOOK}"
        raise reading.fail(user, "photonbeams:look", text)
    key = ("look", prim.GetPath())
    if key not in reading.cache:
        for name in prim.GetAuthoredPropertyNames():
            if name.startswith(PREFIX) and name not in definitions(LOOK):
                reading.warn_of_unknown(prim, str(name), definitions(LOOK))
        reading.cache[key] = read_record(reading, prim, LOOK, LookSpec(str(prim.GetPath())))
    look: LookSpec = reading.cache[key]
    return look
