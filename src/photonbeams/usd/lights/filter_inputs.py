"""Inputs of light filters, which programs write into namespaces of their own: `inputs:ri:lightFilter:width`, say."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...scene import Array, SceneError
from ..common.openusd import Sdf, Usd, UsdGeom, UsdShade
from ..common.reading import Reading, target_paths

# What programs call inputs that readers know by the first of these names.
_NAMES = {
    names[0]: names
    for names in (
        ("edge", "edgeSoftness", "edgeThickness"), ("preBarn", "preBarnEffect"), ("rampMode", "mode"),
        ("beginDist", "beginDistance", "begin_distance"), ("endDist", "endDistance", "end_distance"),
        ("colorRamp_Knots", "colorRamp:knots", "distances"), ("colorRamp_Colors", "colorRamp:colors", "colors"),
        ("colorRamp_Interpolation", "colorRamp:interpolation", "interpolation_types"),
        ("use_near_atten", "falloff_near"), ("use_far_atten", "falloff_far"),
        *((f"scale{size}", f"scale:{size.lower()}") for size in ("Width", "Height", "Depth")),
        *((side, f"refine:{side}") for side in ("left", "right", "bottom", "top", "back", "front")),
    )
}  # fmt: skip
#: Values at which an input that is not rendered has no effect.
_NEUTRAL = {"combineMode": ("mult", "multiply"), "notes": None, "name": None, "linkingGroups": None, "id": None,
            "diffuse": 1, "specular": 1, "saturation": 1, "falloff": None, "colorRamp": None}  # fmt: skip
_NEUTRAL |= {f"{each}Edge": 1 for each in ("left", "right", "bottom", "top", "back", "front")}


# Where Arnold names the graphs whose outputs are a light's filters: on a light, and on a mesh that shines.
_GRAPHS = ("primvars:arnold:shaders", "primvars:arnold:light:shaders")


def filters_of(reading: Reading, prim: Usd.Prim) -> list[Usd.Prim]:
    """Return the prims of a light's filters: what `light:filters` names, and what Arnold's graphs of shaders give."""
    name = next((each for each in ("light:filters", "filters") if target_paths(prim, each)), "")  # before 21.02
    targets = reading.targets(prim, name) if name else []
    shaders = [shader for name in _GRAPHS for shader in _of_graph(reading, prim, name)]
    named = {Inputs.of(reading, each).shader for each in targets}
    return targets + [each for each in dict.fromkeys(shaders) if each not in named]


def _of_graph(reading: Reading, prim: Usd.Prim, name: str) -> list[Usd.Prim]:
    """Return the shaders that are connected to the outputs `filters:i1`, … of the graph that an attribute names."""
    path = str(reading.value(prim, name, ""))
    graph = prim.GetStage().GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) and path.startswith("/") else None
    outputs = UsdShade.ConnectableAPI(graph).GetOutputs() if graph else []
    named = {str(each.GetBaseName()): each for each in outputs if each.GetBaseName().startswith("filters")}
    return [source.source.GetPrim() for name in sorted(named) for source in named[name].GetConnectedSources()[0]]


@dataclass
class Inputs:
    """The inputs of a filter by the last part of their names, and which of them were read.

    Attributes
    ----------
    prim, shader
        The filter, whose place is that of what it does, and the prim that has its inputs: itself or a shader of it.
    """

    reading: Reading
    prim: Usd.Prim
    shader: Usd.Prim
    used: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, reading: Reading, prim: Usd.Prim) -> Inputs:
        """Return the inputs of a filter, or of the shader that is connected to its first output that has one."""
        for output in UsdShade.ConnectableAPI(prim).GetOutputs() if prim else ():
            for source in output.GetConnectedSources()[0]:
                return cls(reading, prim, source.source.GetPrim())
        return cls(reading, prim, prim)

    @property
    def path(self) -> str:
        """The filter's path."""
        return str(self.prim.GetPath())

    @property
    def kind(self) -> str:
        """The kind of the filter: its type or, for a filter or a shader of any kind, the name of its shader."""
        names = ("lightFilter:shaderId", "info:id", "ri:lightFilter:shaderId", "moonray:class")
        values = (self.reading.value(prim, name) for prim in (self.shader, self.prim) for name in names)
        return str(next(filter(None, values), self.prim.GetTypeName()))

    def name(self, name: str) -> str:
        """Return the full name of an input, by the first of its names that is authored."""
        names = _NAMES.get(name, (name,))
        self.used.update(names)
        authored = self.shader.GetAuthoredPropertyNames()
        full = (each for name in names for each in authored if f":{each}".endswith(f":{name}"))
        return next(full, f"inputs:{name}")

    def number(self, name: str, default: float, minimum: float = 0.0) -> float:
        """Return a number, `minimum` or more."""
        return self.reading.number(self.shader, self.name(name), default, minimum=minimum)

    def color(self, name: str, default: float) -> Array:
        """Return a colour, (3,); the default is grey."""
        return np.array(self.reading.color(self.shader, self.name(name), (default,) * 3))

    def flag(self, name: str) -> bool:
        """Return whether something is on; by default it is off."""
        return self.reading.flag(self.shader, self.name(name), False)

    def token(self, name: str, default: str) -> Any:
        """Return a text, or a number that stands for one."""
        return self.reading.value(self.shader, self.name(name), default)

    def array(self, name: str, default: Any) -> Array:
        """Return a list of as many numbers each as the default has, (N, C)."""
        values = np.asarray(default)
        authored = self.reading.array(self.shader, self.name(name), values.shape[1])
        return values if authored is None else authored

    @property
    def gain(self) -> Array:
        """Intensity · 2^exposure · tint, (3,)."""
        exposure = self.reading.number(self.shader, self.name("exposure"), 0.0, -100.0, 100.0)
        return self.number("intensity", 1.0) * 2.0**exposure * self.color("tint", 1.0)

    def fail(self, name: str, text: str) -> SceneError:
        """Return an error about an input, for raising."""
        return self.reading.fail(self.shader, self.name(name), text)

    def warn(self, name: str, text: str) -> None:
        """Warn about an input."""
        self.reading.warn(self.shader, text, self.name(name))

    def warn_of_others(self) -> None:
        """Warn about inputs that were not read, unless their values have no effect."""
        unread = []
        self.used.add("class")  # MoonRay's word for the kind
        for attribute in self.shader.GetAuthoredAttributes():
            name, last = attribute.GetName(), attribute.GetName().rsplit(":", 1)[-1]
            if not name.startswith(("inputs:", "moonray:")) or any(name.endswith(f":{each}") for each in self.used):
                continue
            neutral = _NEUTRAL.get(last, ...)
            value = self.reading.value(self.shader, attribute.GetName())
            if neutral is not None and value not in (neutral if isinstance(neutral, tuple) else (neutral,)):
                unread.append(name)
        if unread:
            self.reading.warn(self.shader, f"has inputs that are not rendered: {', '.join(sorted(unread))}")

    def frame(self) -> Array:
        """Return the transform from the filter's space to the world, (4, 4)."""
        if self.prim.IsA(UsdGeom.Xformable) or not self.prim.HasAttribute("xformOpOrder"):
            return self.reading.to_world(self.prim)
        # The types of other programs are not installed, so OpenUSD does not know that their prims have a place.
        result, parent = np.eye(4), self.prim.GetParent()
        for name in reversed(self.reading.value(self.prim, "xformOpOrder", ())):
            if name == "!resetXformStack!":
                return result
            op = UsdGeom.XformOp(self.prim.GetAttribute(name.removeprefix("!invert!")), name.startswith("!invert!"))
            result = self.reading.matrix(self.prim, op.GetOpTransform(self.reading.time)) @ result
        return result if parent.IsPseudoRoot() else self.reading.to_world(parent) @ result
