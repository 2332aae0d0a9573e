"""Programmed simulation: a Python function changes the beams of each pass (Art, "programmable simulation").

The function takes the beams of one light, or of one set of drawn beams, and returns beams. If they move, it is called
for shutter open and for shutter close, and has to make the same choices at both: random choices depend on
`PassContext.seed` and on the beam's number, not on the time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass

import drjit as dr

from ..numerics.arrays import opaque
from ..runtime.digest import ByContent
from ..scene import DrawnBeams, Medium, SceneError
from ..scene.places import ZERO, Point
from . import Beams
from .sets import BeamSet, shifted


@dataclass(frozen=True, eq=False)
class PassContext(ByContent):
    """The context in which a function changes or makes beams: the light, the pass and the time.

    Attributes
    ----------
    name
        Path of the light, or of the drawn curves, whose beams these are; "" for a function that makes beams from
        nothing.
    group
        Light group of these beams; "" if there is none.
    pass_index
        Number of the pass, from 0. A light has other beams in each pass; drawn beams are the same in all passes.
    seed
        Seed of the render's samples.
    frame
        The frame that is rendered; None is the stage's default time.
    time
        Time code of these beams. Within the shutter interval it differs from the frame.
    medium
        The fog, or None.
    bounds
        Centre (x, y, z) and radius of a sphere around everything in the shot, in scene units.

    Notes
    -----
    The shot makes a context for each light and pass. A function is called for the beginning of the pass's part of the
    shutter interval. If the light's beams move, it is called for the end, too, and has to make the same choices at
    both: let random choices depend on `seed` and on the beams' `id`, not on `time`.

    Examples
    --------
    >>> def flicker(beams, context):
    ...     if context.frame == 7:
    ...         beams.power = beams.power * 0.5
    ...     return beams
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    >>> flicker(beams, pb.PassContext("/World/Lamp", frame=7)).arrays()["power"].tolist()
    [[4.5, 4.5, 4.5]]
    """

    name: str = ""
    group: str = ""
    pass_index: int = 0
    seed: int = 0
    frame: float | None = None
    time: float = 0.0
    medium: Medium | None = None
    bounds: tuple[tuple[float, float, float], float] = ((0.0, 0.0, 0.0), 1.0)


#: A function that takes `Beams` and a `PassContext`, and returns the changed `Beams`: for `Shot.open(simulate=...)`.
Modifier = Callable[[Beams, PassContext], Beams]

#: A function that takes a `PassContext`, and makes beams from nothing.
Emitter = Callable[[PassContext], "DrawnBeams | Beams | Sequence[DrawnBeams | Beams]"]


def chain(*modifiers: Modifier) -> Modifier:
    """Return a modifier that applies several modifiers in order.

    Parameters
    ----------
    *modifiers
        Functions of `Beams` and a `PassContext` that return `Beams`. The first one is applied first.

    Examples
    --------
    >>> warmer = pb.chain(pb.recolor((1, 0.75, 0.5)), pb.clamp(power=3))
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    >>> warmer(beams, pb.PassContext()).arrays()["power"].round(3).tolist()
    [[3.0, 2.25, 1.5]]
    """

    def all_of_them(beams: Beams, context: PassContext) -> Beams:
        for modifier in modifiers:
            beams = modifier(beams, context)
        return beams

    return all_of_them


@dataclass(frozen=True)
class Program:
    """A modifier, with what the shot knows of its context."""

    modifier: Modifier
    frame: float | None = None  # that is rendered; None is the stage's default time
    code: Callable[[float], float] = float  # returns the time code of a fraction of the shutter interval

    def __call__(
        self,
        sets: Sequence[BeamSet],
        pass_index: int,
        seed: int,
        times: Sequence[float],
        medium: Medium | None,
        bounds: tuple[tuple[float, float, float], float],
        zero: Point = ZERO,
    ) -> list[BeamSet]:
        """Return the changed beam sets of a pass.

        Parameters
        ----------
        sets, pass_index, seed, medium, bounds
            The beam sets, and the values of their `PassContext`.
        times
            Fractions of the shutter interval at which the pass opens and closes.
        zero
            Where the coordinates of `bounds`, and those that the function sees, begin in those of the beams.

        Raises
        ------
        SceneError
            If the function does not return beams, if their numbers are not finite, or if the beams at shutter close are
            not those at shutter open.
        """
        result = []
        for each in sets:
            contexts = [
                PassContext(
                    name=each.name,
                    group=each.group,
                    pass_index=pass_index,
                    seed=seed,
                    frame=self.frame,
                    time=self.code(time),
                    medium=medium,
                    bounds=bounds,
                )
                for time in times
            ]
            beams = self._changed(each.beams, contexts[0], zero)
            close = None if each.close is None else self._changed(each.close, contexts[-1], zero)
            if close is not None and (len(close) != len(beams) or _fields(close) != _fields(beams)):
                raise SceneError(
                    f"{_called(self.modifier)} returned {beams} of {each.name} at shutter open and {close} at shutter "
                    "close: expected the same beams"
                )
            result.append(each._replace(beams=beams, close=close))
        return result

    def _changed(self, beams: Beams, context: PassContext, zero: Point) -> Beams:
        given = shifted(beams, -opaque(zero)) if any(zero) else beams
        seen = copy(given)  # the function may write into the beams that it gets
        found = checked(self.modifier(given, context), f"{_called(self.modifier)} returned, of {context.name},")
        if not any(zero):
            return found
        result = shifted(found, opaque(zero))
        for name in ("start", "end", "side"):
            own, exact = getattr(found, name), getattr(beams, name)
            # Single precision is coarse far from zero: places that the function left as they were stay exact.
            if len(found) == len(beams) and own is not None and exact is not None:
                setattr(result, name, dr.select(own == getattr(seen, name), exact, getattr(result, name)))
        return result


def checked(found: object, place: str) -> Beams:
    """Return the beams that a function returned; raise SceneError, beginning with `place`, unless they are finite."""
    if not isinstance(found, Beams):
        raise SceneError(f"{place} {_kind(found)}: expected Beams")
    if not len(found):
        return found
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
        raise SceneError(f"{place} beams of negative power: expected power of 0 or more")
    return result


def emitted(emitter: Emitter, context: PassContext) -> list[DrawnBeams]:
    """Return the beams that a function makes from nothing; beams without a name are named after the function."""
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


def _called(function: object) -> str:
    return str(getattr(function, "__name__", None) or type(function).__name__)


def _kind(value: object) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"
