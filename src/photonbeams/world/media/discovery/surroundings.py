"""Find the media around emitters and the sensor, the medium of the background, and the sizes of media.

The media that emitters, sensors and shapes name are taken as stated. Where they name none, random walks find them: a
walk stays in one medium while surfaces reflect it, or while it passes surfaces that name no media, so the first
interface that it meets tells in which medium it began. A wall that names no medium tells nothing. Walks that pass
interfaces measure the extent of each medium, and find statements that contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ....numerics.sampling import pairs, sobol_points
from ....runtime.device import Array3f, Float, UInt32, mitsuba
from ....scene import Array
from ...shadow_rays import size_of
from ..interfaces import UNKNOWN, medium_at, number
from ..media import Media
from .probes import ASKING, CROSSING, ONWARD, walk
from .survey import MediumEstimate, Survey

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import MiEmitter, MiMedium, MiScene, MiSensor

mi = mitsuba()

# Number of walks from each emitter.
_WALKS = 64


@dataclass(frozen=True)
class Place:
    """An emitter or a sensor, and some of its rays.

    Attributes
    ----------
    name
        The emitter or the sensor, for messages.
    origin, direction
        (N, 3) each; N may be 0.
    named
        The Mitsuba medium that the emitter or the sensor names, or None.
    other
        A second one that it names, or None.
    infinite
        Whether it is an emitter infinitely far away, whose rays begin around the scene.
    """

    name: str
    origin: Array
    direction: Array
    named: Any = None
    other: Any = None
    infinite: bool = False


class Surroundings:
    """The media around emitters and the sensor.

    Parameters
    ----------
    plugin
        The Mitsuba scene.
    media
        Its media.
    emitters, sensor
        The places where light paths and camera paths begin.

    Attributes
    ----------
    everywhere
        The number of the medium that fills the background; 0 if none does.
    sizes
        Radius of each medium, by its number; media as large as the scene have no entry.
    conflicts
        Sentences about statements that contradict each other.
    inside_out
        Numbers of shapes whose `interior` fills the space around them.
    """

    def __init__(self, plugin: MiScene, media: Media, emitters: Sequence[Place], sensor: Place | None = None) -> None:
        self._scene, self._size = plugin, size_of(plugin)
        places = [*emitters, *([] if sensor is None else [sensor])]
        self.everywhere, self.sizes, self.conflicts = 0, dict[int, float](), list[str]()
        self.inside_out: set[int] = set()
        self._sensor = len(places) - 1
        self._answers = [MediumEstimate(0, True)] * len(places)
        if media.all and plugin.shapes():
            self._survey(media, places, len(emitters))
        elif media.all:
            self.everywhere = next((number(each.named) for each in places if each.named is not None), 0)
            self._answers = [MediumEstimate(number(each.named) or self.everywhere, True) for each in places]

    def of_emitter(self, index: int, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which paths of an emitter begin."""
        return self._around(self._answers[index], origin, direction)

    def of_sensor(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera paths begin."""
        return self._around(self._answers[self._sensor], origin, direction)

    def _around(self, answer: MediumEstimate, origin: Array3f, direction: Array3f) -> UInt32:
        width = max(dr.width(origin), dr.width(direction))
        usual = dr.opaque(UInt32, answer.usual, width)
        if answer.known:
            return usual
        return medium_at(self._scene, origin, direction, usual, dr.opaque(UInt32, self.everywhere), size=self._size)

    def _survey(self, media: Media, places: Sequence[Place], emitters: int) -> None:
        rng = np.random.default_rng(0)
        survey = Survey(self._scene, media, rng)
        origins, directions = [each.origin for each in places], [each.direction for each in places]
        bounds = np.cumsum([0, *(len(each) for each in origins)]).tolist()
        outside = survey.outside()
        begin = np.concatenate([*origins, outside[0]]), np.concatenate([*directions, outside[1]])
        asking, onward = (walk(self._scene, *begin, rng, kind, self._size) for kind in (ASKING, ONWARD))
        self.everywhere = survey.everywhere(asking.part(bounds[-1], None), places)
        self._answers, states = [], []
        for index, (place, *part) in enumerate(zip(places, bounds[:-1], bounds[1:], strict=True)):
            answer = survey.answer(place, asking.part(*part), onward.part(*part), self.everywhere)
            # Rays to either side of an interface begin in different media. So do a lamp's rays through a hole in a
            # shape with a medium inside: a camera path that leaves the shape through the hole stays in that medium.
            through = index < emitters and survey.sees_within(place, answer, asking.part(*part))
            known = answer.known and not survey.on_interface(place)
            self._answers.append(MediumEstimate(answer.usual, known and not through))
            states.append(np.full(len(place.origin), answer.usual if known else UNKNOWN))
        around = survey.around()
        begin = np.concatenate([*origins, around[0]]), np.concatenate([*directions, around[1]])
        state = np.concatenate([*states, np.full(len(around[0]), UNKNOWN)])
        source = np.repeat(np.arange(len(places) + 1), [*map(len, origins), len(around[0])])
        if len(state):
            walks = walk(self._scene, *begin, rng, CROSSING, self._size)
            self.sizes = survey.measure(walks, state, [*(each.name for each in places), ""], source)
        self.conflicts, self.inside_out = survey.statements.conflicts, survey.statements.inside_out


def places_of(plugin: Any) -> list[Place]:
    """Return the places where light paths of a Mitsuba scene begin, one for each emitter."""
    u, v = _samples()
    result = []
    for each in plugin.emitters():
        ray, _ = each.sample_ray(Float(0), Float(0.5), u, v, True)
        name = (each.get_shape() or each).id() or each.class_name()
        place = place_of(f"emitter {name}", ray.o, ray.d, *_named_by(each))
        result.append(replace(place, infinite=mi.has_flag(each.flags(), mi.EmitterFlags.Infinite)))
    return result


def place_of_sensor(plugin: Any) -> Place:
    """Return the place where camera paths of a Mitsuba sensor begin."""
    ray, _ = plugin.sample_ray_differential(Float(0), Float(0.5), *_samples(), True)
    return place_of(f"sensor {plugin.id() or plugin.class_name()}", ray.o, ray.d, *_named_by(plugin))


def _samples() -> tuple[Any, Any]:
    """Return samples for rays: two dimensions for the place, and two for the direction."""
    u, v = pairs(sobol_points(_WALKS, 0, (_WALKS,)))
    return mi.Point2f(u), mi.Point2f(v)


def _named_by(plugin: MiEmitter | MiSensor) -> tuple[MiMedium | None, MiMedium | None]:
    """Return the medium that an emitter or a sensor names (its shape's exterior, else its own), and a second one."""
    shape, own = plugin.get_shape(), plugin.get_medium()
    outside = None if shape is None else shape.exterior_medium()
    return (own, None) if outside is None else (outside, own)


def place_of(
    name: str, origin: Any, direction: Any, named: MiMedium | None = None, other: MiMedium | None = None,
    most: int = _WALKS,
) -> Place:  # fmt: skip
    """Return the place of an emitter or a sensor: at most `most` of its rays, and their reverses."""
    wide = dr.zeros(Array3f, max(dr.width(origin), dr.width(direction)))
    origin, direction = ((Array3f(each) + wide).numpy().T.astype(np.float64) for each in (origin, direction))
    good = np.isfinite(origin).all(axis=1) & np.isfinite(direction).all(axis=1) & (np.abs(direction).max(axis=1) > 0)
    origin, direction = origin[good], direction[good]
    chosen = np.unique(np.linspace(0, len(origin) - 1, most).astype(int)) if len(origin) else np.zeros(0, dtype=int)
    origin, direction = origin[chosen], direction[chosen]
    return Place(name, np.concatenate([origin, origin]), np.concatenate([direction, -direction]), named, other)
