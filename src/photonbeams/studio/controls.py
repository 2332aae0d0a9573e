"""The controls of a stage as pages get them: descriptions, values by path, and edits of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

from ..usd.authoring.controls import Control, Controls
from . import protocol


def described(found: Sequence[Controls]) -> list[protocol.ControlGroup]:
    """Return controls as pages get them."""
    return [
        protocol.ControlGroup(
            group.path, cast(Any, group.kind), group.label, group.type, [_item(each) for each in group.controls],
            group.uses,
        )
        for group in found
    ]  # fmt: skip


def _item(control: Control) -> protocol.ControlItem:
    return protocol.ControlItem(
        path=control.path, label=control.label, section=control.section, kind=cast(Any, control.kind),
        value=control.value, default=control.default, authored=control.authored, min=control.least, max=control.most,
        soft=control.slider, choices=control.choices, unit=control.unit, doc=control.doc, parts=dict(control.parts),
        needs={path: list(wanted) for path, wanted in control.needs.items()},
    )  # fmt: skip


def shape(groups: list[protocol.ControlGroup]) -> list[Any]:
    """Return the parts of controls that only the message about the scene carries."""
    return [(group.path, group.uses, [(each.path, each.choices) for each in group.controls]) for group in groups]


def flat(groups: list[protocol.ControlGroup]) -> dict[str, tuple[Any, bool]]:
    """Return the values of controls by path, and whether they are authored; ramps have a path for each part."""
    found: dict[str, tuple[Any, bool]] = {}
    for control in (each for group in groups for each in group.controls):
        if control.kind == "ramp":
            found |= {path: (control.value[part], control.authored) for part, path in control.parts.items()}
        else:
            found[control.path] = (control.value, control.authored)
    return found


def note(groups: list[protocol.ControlGroup], edited: dict[str, Any]) -> None:
    """Change the values of controls to edited ones."""
    for control in (each for group in groups for each in group.controls):
        for part, path in control.parts.items():
            if path in edited:
                control.value, control.authored = {**control.value, part: edited[path]}, True
        if control.path in edited:
            control.value, control.authored = edited[control.path], True
