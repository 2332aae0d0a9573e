"""Simulation, programmed: a Python function changes the beams of each pass (Art, "programmable simulation").

The function is given the beams of one light, or of one set of drawn beams, and returns beams. Where anything moves it
is called for shutter open and for shutter close, and must do the same at both: what it chooses at random, it chooses by
`PassContext.seed` and the number of the beam, not by the time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..scene import DrawnBeams, Medium, SceneError
from . import Beams
from .sets import BeamSet


@dataclass(frozen=True)
class PassContext:
    """The context of a function of beams.

    Attributes
    ----------
    name
        Path of the light, or of the curves, that the beams are of; "" for beams from nothing.
    group
        Its light group, or "".
    pass_index
        Number of the pass, from 0. Each pass has other beams of a light, and the same of what is drawn.
    seed
        Seed of the render's samples.
    frame
        The frame that is rendered; None: the stage's default time.
    time
        Time code of the moment at which the beams are what they are: while the shutter is open, later than the frame.
    medium
        The fog, or None.
    bounds
        Centre and radius of a sphere around everything in the shot.
    """

    name: str = ""
    group: str = ""
    pass_index: int = 0
    seed: int = 0
    frame: float | None = None
    time: float = 0.0
    medium: Medium | None = None
    bounds: tuple[tuple[float, float, float], float] = ((0.0, 0.0, 0.0), 1.0)


#: A function that changes beams.
Modifier = Callable[[Beams, PassContext], Beams]

#: A function that makes beams from nothing.
Emitter = Callable[[PassContext], "DrawnBeams | Beams | Sequence[DrawnBeams | Beams]"]


def chain(*modifiers: Modifier) -> Modifier:
    """Return the modifier that applies these, the first one first.

    Examples
    --------
    >>> import photonbeams as pb
    >>> softer = pb.chain(pb.thin(0.5), pb.recolor((1, 0.8, 0.5)))
    """

    def all_of_them(beams: Beams, context: PassContext) -> Beams:
        for modifier in modifiers:
            beams = modifier(beams, context)
        return beams

    return all_of_them


@dataclass(frozen=True)
class Program:
    """A modifier with the context that the shot provides.

    Attributes
    ----------
    modifier
        The function.
    frame
        The frame that is rendered.
    code
        Returns the time code of a fraction of the shutter.
    """

    modifier: Modifier
    frame: float | None = None
    code: Callable[[float], float] = float

    def __call__(
        self,
        sets: Sequence[BeamSet],
        pass_index: int,
        seed: int,
        times: Sequence[float],
        medium: Medium | None,
        bounds: tuple[tuple[float, float, float], float],
    ) -> list[BeamSet]:
        """Return the sets of a pass, changed; `times` are fractions of the shutter at which the pass opens and closes.

        Raises
        ------
        SceneError
            A function that returns no beams, beams that are no numbers, or other beams at shutter close.
        """
        result = []
        for each in sets:
            contexts = [
                PassContext(each.name, each.group, pass_index, seed, self.frame, self.code(time), medium, bounds)
                for time in times
            ]
            beams = self._changed(each.beams, contexts[0])
            close = None if each.close is None else self._changed(each.close, contexts[-1])
            if close is not None and (len(close) != len(beams) or _fields(close) != _fields(beams)):
                raise SceneError(
                    f"{_called(self.modifier)} returned {beams} of {each.name} at shutter open and {close} at shutter "
                    "close: expected the same beams"
                )
            result.append(each._replace(beams=beams, close=close))
        return result

    def _changed(self, beams: Beams, context: PassContext) -> Beams:
        return checked(self.modifier(beams, context), f"{_called(self.modifier)} returned, of {context.name},")


def checked(found: Any, place: str) -> Beams:
    """Return a function's beams; raise SceneError, beginning with `place`, for anything but finite beams."""
    if not isinstance(found, Beams):
        raise SceneError(f"{place} {_kind(found)}: expected Beams")
    fields = {name: getattr(found, name, None) for name in Beams.DRJIT_STRUCT}
    try:
        result = Beams(**fields)
    except SceneError as error:
        raise SceneError(f"{place} {error}") from None
    for name, value in fields.items():
        numbers = getattr(result, name)
        if value is not None and not bool(dr.all(dr.isfinite(numbers), axis=None)):
            raise SceneError(f"{place} beams whose {name} is not finite: expected finite numbers")
    if not bool(dr.all(result.power >= 0, axis=None)):
        raise SceneError(f"{place} beams of negative power: expected none below 0")
    return result


def emitted(emitter: Emitter, context: PassContext) -> list[DrawnBeams]:
    """Return the beams that a function makes from nothing, named after it where they have no name."""
    found = emitter(context)
    several = list(found) if isinstance(found, Sequence) else [found]
    result = []
    for number, each in enumerate(several):
        name = f"/{getattr(emitter, '__name__', 'emit')}" + (f"_{number}" if len(several) > 1 else "")
        if isinstance(each, DrawnBeams):
            numbers = Beams(**each.arrays())
            checked(numbers, f"{_called(emitter)} returned, as {each.name},")
        else:
            numbers = checked(each, f"{_called(emitter)} returned")
            each = DrawnBeams(name=name, **numbers.arrays())  # type: ignore[arg-type]
        result.append(each)
    return result


def _fields(beams: Beams) -> set[str]:
    return {name for name in Beams.DRJIT_STRUCT if getattr(beams, name) is not None}


def _called(function: Any) -> str:
    return str(getattr(function, "__name__", None) or type(function).__name__)


def _kind(value: Any) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"
