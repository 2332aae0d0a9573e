"""Read `PhotonBeamsLook` prims as plain numbers: a LookSpec, from which a look is built."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ...scene import Array, rgb
from ..common.definitions import LOOK, PREFIX, definitions
from ..common.openusd import Usd
from ..common.reading import Reading

#: The factors of a look that may have a ramp, a texture and an expression.
FACTORS = ("along", "across", "eye", "angle")


@dataclass(frozen=True)
class LookSpec:
    """A checked look in plain numbers.

    Attributes
    ----------
    name
        The path of the prim.
    values
        The values of the attributes of a `PhotonBeamsLook`, by their names without "photonbeams:". The schema says what
        each means. A texture is colours (M, 3) from begin to end, or None.
    """

    name: str
    values: Mapping[str, Any]


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
        values = {name.removeprefix(PREFIX): own.read(reading, prim) for name, own in definitions(LOOK).items()}
        for factor in FACTORS:
            values[f"{factor}:texture"] = _row(values[f"{factor}:texture"])
        for name, text in _problems(values):
            raise reading.fail(prim, f"{PREFIX}{name}", text)
        reading.cache[key] = LookSpec(str(prim.GetPath()), values)
    look: LookSpec = reading.cache[key]
    return look


def _row(pixels: Array | None) -> Array | None:
    """Return a 1D texture, which may be several pixels high, as colours (M, 3)."""
    return None if pixels is None else rgb(pixels.mean(axis=0, dtype=np.float64))


def _problems(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Return what does not go together, as names of attributes and texts such as "is empty: expected ..."."""
    for factor in FACTORS:
        yield from ((f"{factor}:{name}", text) for name, text in _problems_of_factor(values, factor))
    if values["along:falloff"] == "polynomial" and not values["along:coefficients"]:
        yield "along:coefficients", "is empty: a polynomial falloff expects its coefficients"
    inner, outer = values["along:inner"], values["along:outer"]
    if 0 < outer <= inner:
        yield "along:outer", f"is {outer:g}: expected more than inner, {inner:g}, or 0"
    profile = values["across:values"]
    if values["across:profile"] == "tabulated" and (len(profile) < 2 or min(profile) < 0 or max(profile) == 0):
        text = f"is {list(profile)}: a tabulated profile expects two values or more, none negative and not all 0"
        yield "across:values", text


def _problems_of_factor(values: Mapping[str, Any], factor: str) -> Iterator[tuple[str, str]]:
    """Return an end before the beginning, and what is wrong with the ramp, the texture and the expression."""
    begin, end = values.get(f"{factor}:begin", 0), values.get(f"{factor}:end", 1)
    if end <= begin:
        yield "end", f"is {end:g}: expected more than begin, {begin:g}"
    knots, colors = values[f"{factor}:ramp:knots"], values[f"{factor}:ramp:colors"]
    if len(knots) != len(colors):
        yield "ramp:knots", f"has {len(knots)} values but ramp:colors has {len(colors)}: expected as many of each"
    if any(b <= a for a, b in pairwise(knots)):
        yield "ramp:knots", f"is {list(knots)}: expected ascending positions"
    texture = values[f"{factor}:texture"]
    if texture is not None and np.any(texture < 0):
        yield "texture", "has negative pixels: expected colours of 0 or more"
    if expression := values[f"{factor}:expression"]:
        try:
            from ...looks.expression import parse  # starts Dr.Jit

            parse(expression)
        except ValueError as error:
            yield "expression", f"is wrong: {error}"
