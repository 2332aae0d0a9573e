"""What is known of a setting: its meaning, the values that it may have, and where a user finds it.

The command's options, the plug-in's parameters, their checks and the tables of the documentation are made from it.
Nothing heavy is imported, so that the command's help is fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from numbers import Integral, Real
from typing import Any

_Named = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A number, a choice, or yes or no, which a user may set.

    Attributes
    ----------
    help
        Its meaning.
    name
        What a user calls it: a flag of the command, or a parameter of the plug-in.
    kind
        int, float, bool, str, or another class, of which values are instances.
    least, above, most, below
        Bounds of a number.
    choices
        The words that it may be.
    expected
        What a message says was expected; by default it is made from the kind and the bounds.
    default
        Its default; None leaves the choice to the scene.
    metavar
        What the command's help calls the value.
    reader
        "stage" or "scene" if only stages or only Mitsuba scenes have a use for it.
    """

    help: str = ""
    name: str = ""
    kind: type = float
    least: float | None = None
    above: float | None = None
    most: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()
    expected: str = ""
    default: Any = None
    metavar: str | None = None
    reader: str = ""

    @property
    def type_name(self) -> str:
        """What its type is called."""
        return "string" if self.choices else self.kind.__name__

    def checked(self, value: object, name: str) -> Any:
        """Return a value as Python's own int, float, bool or str; raise SceneError, with the `name`, for any other."""
        from .scene import SceneError, whole
        from .scene.checks import as_float, choice, plain, shown

        if self.choices:
            return choice(value, name, self.choices)
        result = whole(value, name) if self.kind is int else plain(value)
        of_numpy = isinstance(result, Integral) and type(result) is not int
        if self.kind is bool and of_numpy and result in (0, 1):
            result = bool(result)
        if self.kind is float and isinstance(result, Real):
            result = as_float(result)
        if not (isinstance(result, self.kind) and self._within(result)):
            raise SceneError(f"{name} is {shown(value)}: expected {self.expected or self._expected()}")
        return result

    def _within(self, value: Any) -> bool:
        return (
            (self.kind is not float or isfinite(value))
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
        )

    def _expected(self) -> str:
        """Return what a message says was expected, from the kind and the bounds."""
        if self.kind is bool:
            return "True or False"
        if self.kind is int:
            return f"{self.least} to {self.most}"
        if self.kind is not float:
            return f"a {self.kind.__name__}"
        if self.least is not None and self.most is not None:
            return f"{self.least:g} to {self.most:g}"
        bounds = [
            text.format(bound)
            for text, bound in (("above {:g}", self.above), ("at most {:g}", self.most), ("below {:g}", self.below))
            if bound is not None
        ]
        return " ".join(("a number", " and ".join(bounds)))


def setting(
    default: object, help: str, flags: _Named | None = None, parameter: _Named | None = None, **own: Any
) -> Any:
    """Return a field of `Settings`.

    Parameters
    ----------
    default, help, **own
        Attributes of its `Setting`.
    flags, parameter
        Names of the flags that set it, and the name of the plug-in's parameter, each with the attributes in which it
        differs from the field.
    """
    made = Setting(help=help, default=default, **own)
    listed, read = (
        tuple(replace(made, name=name, **other) for name, other in (named or {}).items())
        for named in (flags, parameter)
    )
    return field(default=default, metadata={"setting": made, "flags": listed, "parameters": read})
