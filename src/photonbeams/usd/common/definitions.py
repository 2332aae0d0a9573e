"""Attributes of our own schemas: their types, fallbacks, ranges, allowed tokens and texts, and how they are read.

All of these are written once, in `schema/schema.usda`: ranges as OpenUSD's `limits`, whose soft ones are those of
sliders, and as `customData` whether the ends of a range are outside of it (`open`), and a unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ...scene import color
from ...scene.checks import shown
from .openusd import INSTALLED, Plug, Sdf, Usd
from .reading import Reading
from .textures import read_image

#: The folder of the codeless schemas, which importing this module registers with OpenUSD. OpenUSD builds its registry
#: when the first stage is opened: a program that opens one before can still read the attributes, but cannot define a
#: `PhotonBeamsLook` by type.
FOLDER = Path(__file__).parent.parent / "schema"
if INSTALLED:
    Plug.Registry().RegisterPlugins(str(FOLDER))

PREFIX = "photonbeams:"
LIGHT, LOOK = "PhotonBeamsLightAPI", "PhotonBeamsLook"
CURVES, MEDIUM = "PhotonBeamsCurvesAPI", "PhotonBeamsMediumAPI"
CAMERA = "PhotonBeamsCameraAPI"
BLOCKER, RAMP = "PhotonBeamsBlockerFilter", "PhotonBeamsRampFilter"


@dataclass(frozen=True)
class Definition:
    """What a schema says about an attribute or a relationship.

    Attributes
    ----------
    kind
        One of number, integer, bool, color, numbers (a list), choice, text, expression, asset or paths.
    default
        The fallback in plain numbers, or None.
    columns, length
        How many numbers each value of a list has, and how many values it has; None: any number.
    least, most
        The range of a number; None: no bound. The ends of an `open` range are outside of it.
    slider
        The usual range, if it is another.
    """

    name: str
    kind: str
    default: Any = None
    columns: int = 1
    length: int | None = None
    choices: tuple[str, ...] = ()
    least: float | None = None
    most: float | None = None
    open: bool = False
    slider: tuple[float, float] | None = None
    unit: str = ""
    doc: str = ""

    @classmethod
    def of(cls, own: Sdf.PropertySpec) -> Definition:
        """Return the definition of a property in a layer of schemas."""
        info, doc = own.GetInfo, " ".join(own.documentation.split())
        if not info("typeName"):
            return cls(own.name, "paths", [], doc=doc)
        value_type = Sdf.ValueTypeNames.Find(str(info("typeName")))
        choices = tuple(map(str, info("allowedTokens") or ()))
        limits, custom = info("limits") or {}, info("customData") or {}
        hard, soft = ({end: plain(each) for end, each in limits.get(which, {}).items()} for which in ("hard", "soft"))
        size = getattr(value_type.scalarType.defaultValue, "dimension", 1)
        expression = own.name.endswith("expression")
        return cls(
            own.name,
            "choice" if choices else "expression" if expression else _kind_of(value_type),
            plain(info("default")),
            columns=size if value_type.isArray else 1,
            length=None if value_type.isArray else size,
            choices=choices,
            least=hard.get("minimum"),
            most=hard.get("maximum"),
            open=bool(custom.get("open")),
            slider=(soft["minimum"], soft["maximum"]) if soft else None,
            unit=custom.get("unit", ""),
            doc=doc,
        )

    def read(self, reading: Reading, prim: Usd.Prim, default: object = None) -> Any:
        """Return the value on a prim in plain numbers, texts and tuples, or the pixels of an image; None: no value.

        `default` is used instead of the schema's where the prim has no value.

        Raises
        ------
        SceneError
            The value has another type, is not finite or is out of range, or its image cannot be read.
        """
        value = reading.value(prim, self.name, self.default if default is None else default)
        if value is None:
            return None
        match self.kind:
            case "bool":
                return bool(value)
            case "text" | "expression":
                return str(value).strip() if self.kind == "expression" else str(value)
            case "asset":
                return read_image(reading, prim, self.name)
            case "color":
                return reading.color(prim, self.name, value)
            case "choice":
                return reading.choice(prim, self.name, value, self.choices)
            case "numbers":
                return self._list(reading, prim)
        return self._number(reading, prim, value)

    def _number(self, reading: Reading, prim: Usd.Prim, value: Any) -> float:
        """Return a number; whole ones, and those of open ranges, have messages of their own."""
        least, most = -np.inf if self.least is None else self.least, np.inf if self.most is None else self.most
        if self.kind == "integer":
            if isinstance(value, int) and least <= value <= most:
                return int(value)
            ends = f", {least:,} or more" if most == np.inf else f" from {least:,} to {most:,}"
            text = f"is {shown(value)}: expected a whole number{ends if least > -np.inf else ''}"
            raise reading.fail(prim, self.name, text)
        if not self.open:
            return reading.number(prim, self.name, value, least, most)
        number = reading.number(prim, self.name, value)
        if not least < number < most:
            text = f"is {number:g}: expected more than {least:g}{'' if most == np.inf else f' and less than {most:g}'}"
            raise reading.fail(prim, self.name, text)
        return number

    def _list(self, reading: Reading, prim: Usd.Prim) -> tuple[Any, ...]:
        """Return numbers, or colours, which are 0 or more."""
        values = reading.array(prim, self.name, self.columns)
        if values is None and self.length is not None:  # without the schema a prim has no fallback
            return tuple(self.default)
        count = 0 if values is None else len(values)
        if self.length is not None and count != self.length:
            raise reading.fail(prim, self.name, f"has {count} values: expected {self.length}")
        if values is None or self.columns == 1:
            return () if values is None else tuple(values[:, 0].tolist())
        place = reading.place(prim, self.name)
        return tuple(color(each, f"{place}[{index}]") for index, each in enumerate(values))


@cache
def definitions(schema: str) -> Mapping[str, Definition]:
    """Return the definitions of a schema's own properties by name, in the order of the schema.

    They do not come from OpenUSD's registry, which lacks them if a program opened a stage before it imported this
    package.
    """
    layer = Sdf.Layer.FindOrOpen(str(FOLDER / "schema.usda"))
    return {each.name: Definition.of(each) for each in layer.GetPrimAtPath(f"/{schema}").properties}


def read_attribute(reading: Reading, prim: Usd.Prim, schema: str, name: str, default: object = None) -> Any:
    """Return the value of an attribute, named without its prefix, as `Definition.read` does."""
    return definitions(schema)[PREFIX + name].read(reading, prim, default)


def _kind_of(value_type: Sdf.ValueTypeName) -> str:
    default = value_type.defaultValue
    if value_type.role == "Color" and not value_type.isArray:
        return "color"
    if value_type.isArray or hasattr(default, "dimension"):
        return "numbers"
    kinds = ((bool, "bool"), (int, "integer"), (float, "number"), (Sdf.AssetPath, "asset"))
    return next((kind for each, kind in kinds if isinstance(default, each)), "text")


def plain(value: Any) -> Any:
    """Return a USD value as JSON represents it."""
    if isinstance(value, float):  # most are 32-bit floats: show them as they were written
        return float(str(np.float32(value))) if np.float32(value) == value else value
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Sdf.AssetPath):
        return value.path
    return [plain(each) for each in value]
