"""Why the picture of a stage would be dark or blurred, and what to type."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import numpy as np

from ...scene import Light
from ...shot.lent import LIGHTS, VIEW
from ...shot.survey import Survey
from ...usd.groups import hidden_lights
from .words import percent

if TYPE_CHECKING:
    from pxr import Usd

# Less than this fraction of the picture lit is dark without bounces; and from so many stops on, an exposure is advised.
_LIT, _STOPS = 0.5, 2.0
# A fog of less optical depth, up to what the camera sees, hardly shows; one of more hides what it sees.
_THIN, _THICK = 0.03, 3.0

#: A reason, and what to type.
Reason = tuple[str, str]


def advice(stage: Usd.Stage, time: Usd.TimeCode, survey: Survey) -> Iterator[Reason]:
    """Yield the reasons why the picture would be dark, without shafts or blurred, each with what to type."""
    if not survey.cameras or VIEW in survey.cameras:
        instead = f": {VIEW} shows all of it" if survey.cameras else ""
        yield f"the stage has no camera{instead}", "add one where the stage comes from, then export again"
    if not survey.cameras:
        return
    yield from _of_lights(stage, time, survey)
    yield from _of_fog(stage, survey)
    if survey.scene.lights:
        yield from _of_surfaces(survey)
    for each in survey.doubts:
        reason, _, what = each.partition(": expected ")
        yield reason, what


def _of_lights(stage: Usd.Stage, time: Usd.TimeCode, survey: Survey) -> Iterator[Reason]:
    scene = survey.scene
    lent = [each.name for each in scene.lights if each.name in LIGHTS]
    if lent or not (scene.lights or scene.drawn):
        hidden = hidden_lights(stage, time)
        if hidden:
            yield "all lights are hidden", _set(hidden[0], "visibility", "inherited")
        else:
            text = f"the stage has no light{': ' if lent else ''}{' and '.join(lent)}"
            yield text, 'save `def DomeLight "Sky" {}` as sky.usda: --session-layer sky.usda'
        return
    for light in scene.lights:
        if not light.shines:
            yield f"{light.name} is black", _set(light.name, "inputs:intensity", "1")
        elif light.emits_beams and light.beam_count == 0:
            yield f"{light.name} makes no beams", _set(light.name, "photonbeams:count", "4096")
    if not any(map(_makes_beams, scene.lights)) and not scene.drawn:
        domes = any(type(each).__name__ == "DomeLight" for each in scene.lights)
        lights = ", ".join(each.name for each in scene.lights[:2])
        yield "no light makes beams", "--dome-beams" if domes else f"photonbeams:enabled = 1 on {lights}"
    for name, reach in survey.reach.items():
        if not reach.in_fog:
            yield (
                f"no light of {name} gets into fog",
                "look at it from its place: it may stand in a wall or a lamp shade",
            )
        elif name not in survey.shafts:
            text = f"no camera sees fog that {name} lights"
            yield text, "turn it, or open what blocks it: opaque panes of glass do"


def _makes_beams(light: Light) -> bool:
    return light.emits_beams and light.shines and light.beam_count != 0


def _of_fog(stage: Usd.Stage, survey: Survey) -> Iterator[Reason]:
    medium, suits = survey.scene.medium, f"{survey.scattering:g}"
    if not survey.scene.media:
        path = Path(stage.GetRootLayer().realPath)
        named = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
        yield "there is no fog, so no shaft shows", f"--scattering {suits}"
        yield "", f"or, for good: photonbeams dress {quote(str(named))} -o {quote(f'{path.stem}_beams.usda')}"
    elif medium is not None and medium.mesh is None and not medium.varies:
        depth = float(np.mean(medium.extinction)) * survey.distance
        what = _set(medium.name, "photonbeams:scattering", suits) if medium.name else f"--scattering {suits}"
        if max(medium.scattering) == 0:
            yield "the fog scatters no light, so no shaft shows", what
        elif depth < _THIN:
            yield f"the fog is thin: it takes {percent(1 - np.exp(-depth))} of the light of what is seen", what
        elif depth > _THICK:
            yield f"the fog is thick: {percent(np.exp(-depth))} is left of the light of what is seen", what


def _of_surfaces(survey: Survey) -> Iterator[Reason]:
    for camera in survey.cameras:
        lit = survey.lit(camera)
        if lit < _LIT and not survey.scene.bounces:
            yield f"lamps light {percent(lit)} of what {camera} sees, and nothing lights the rest", "--bounces 3"
            break
    first = next(iter(survey.cameras))
    stops = round(survey.exposure(first))
    if stops >= _STOPS:
        yield f"what {first} sees is dark for a screen", f"--exposure {stops}"


def _set(path: str, name: str, value: str) -> str:
    return f"--set {quote(f'{path}.{name}={value}')}"
