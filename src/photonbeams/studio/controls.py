"""The controls of a stage as pages get them: descriptions, values by path, and edits of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from ..usd.authoring.controls import Controls
from . import protocol


def described(found: Sequence[Controls]) -> list[protocol.ControlGroup]:
    """Return controls as pages get them."""
    return msgspec.convert(found, list[protocol.ControlGroup], from_attributes=True)


def shape(groups: list[protocol.ControlGroup]) -> list[Any]:
    """Return the parts of controls that only the message about the scene carries."""
    return [(group.path, group.uses, [(each.path, each.choices) for each in group.controls]) for group in groups]


def states(groups: list[protocol.ControlGroup]) -> dict[str, tuple[Any, bool]]:
    """Return the values of controls by path, and whether they are authored; ramps have a path for each part."""
    result: dict[str, tuple[Any, bool]] = {}
    for control in (each for group in groups for each in group.controls):
        if control.kind == "ramp":
            result |= {path: (control.value[part], control.authored) for part, path in control.parts.items()}
        else:
            result[control.path] = (control.value, control.authored)
    return result
