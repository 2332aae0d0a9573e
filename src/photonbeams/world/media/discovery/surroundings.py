"""Find the media around emitters and the sensor, the medium of the background, and the boxes around media.

The media that emitters, sensors and shapes name are taken as stated. Where they name none, random walks find them: a
walk stays in one medium while surfaces reflect it, or while it passes surfaces that name no media, so the first
interface that it meets tells in which medium it began. A wall that names no medium tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import numpy as np

from ....numerics.arrays import to_numpy
from ....numerics.sampling import pairs, sobol_points
from ....runtime.device import Array3f, Float, UInt32, mitsuba
from ....scene import Array
from ...bounds import Box
from ...emission import entry_sphere, sampled_ray
from ...shadow_rays import size_of
from ..interfaces import UNKNOWN, medium_at, number
from ..media import Media
from .probes import Probes, walk
from .survey import RARE, background, held, media_inside, rays_from_outside

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
    infinite
        Whether it is an emitter infinitely far away, whose rays begin around the scene.
    """

    name: str
    origin: Array
    direction: Array
    named: Any = None
    infinite: bool = False


class _Around(NamedTuple):
    """The medium around a place: that of most of its rays, and whether all rays have it."""

    medium: int
    everyone: bool = True


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
    boxes
        Boxes around the shapes that hold each medium, by its number; media as large as the scene have no entry.
    conflicts
        Sentences about emitters and sensors that name another medium than the shapes around them.
    """

    def __init__(self, plugin: MiScene, media: Media, emitters: Sequence[Place], sensor: Place | None = None) -> None:
        self._scene, self._size = plugin, size_of(plugin)
        places = [*emitters, *([] if sensor is None else [sensor])]
        self.everywhere, self.boxes, self.conflicts = 0, dict[int, Box](), list[str]()
        self._names = {each.number: each.plugin.id() or each.plugin.class_name() for each in media.all}
        self._answers = [_Around(0)] * len(places)
        if media.all and plugin.shapes():
            self._survey(places, len(emitters))
        elif media.all:
            self.everywhere = next((number(each.named) for each in places if each.named is not None), 0)
            self._answers = [_Around(number(each.named) or self.everywhere) for each in places]

    def of_emitter(self, index: int, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which paths of an emitter begin."""
        return self._around(self._answers[index], origin, direction)

    def of_sensor(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera paths begin."""
        return self._around(self._answers[-1], origin, direction)

    def _around(self, answer: _Around, origin: Array3f, direction: Array3f) -> UInt32:
        width = max(dr.width(origin), dr.width(direction))
        usual = dr.opaque(UInt32, answer.medium, width)
        if answer.everyone:
            return usual
        return medium_at(self._scene, origin, direction, usual, dr.opaque(UInt32, self.everywhere), size=self._size)

    def _survey(self, places: Sequence[Place], emitters: int) -> None:
        rng, inside = np.random.default_rng(0), media_inside(self._scene)
        outside = rays_from_outside(self._scene, rng)
        origin = np.concatenate([*(each.origin for each in places), outside[0]])
        direction = np.concatenate([*(each.direction for each in places), outside[1]])
        asking, onward = (walk(self._scene, origin, direction, rng, self._size, each) for each in (False, True))
        bounds = np.cumsum([0, *(len(each.origin) for each in places)]).tolist()
        self.everywhere = background(asking.part(bounds[-1], None), [each.named for each in places], inside)
        self.boxes = {own: box for own, box in held(self._scene).items() if own != self.everywhere}
        self._answers = []
        for index, (place, *part) in enumerate(zip(places, bounds[:-1], bounds[1:], strict=True)):
            if place.named is not None:
                self._answers.append(_Around(number(place.named)))
                self._check(place, asking.part(*part), inside)
            else:
                answer = self._found(asking.part(*part), onward.part(*part))
                # A camera path that enters a shape through a hole stays in the medium where it began. A lamp's path,
                # which a camera path meets in the shape, begins in the medium of the shape.
                pinhole = index >= emitters and _is_one_point(place.origin)
                self._answers.append(_Around(answer.medium, answer.everyone or pinhole))

    def _found(self, asking: Probes, onward: Probes) -> _Around:
        """Return the medium that most walks from a place find.

        Walls that name no medium lie within the medium around them. If walks find no medium, those that pass walls
        (`onward`) may; if these find none either, it is `everywhere`.
        """
        told = asking.known(self.everywhere)
        told = told if len(told) else onward.known(self.everywhere)
        if not len(told):
            return _Around(self.everywhere)
        return _Around(_most(told), len(set(told)) == 1)

    def _check(self, place: Place, walks: Probes, inside: set[int]) -> None:
        """Note a contradiction between what an emitter or a sensor names and what the shapes around it name."""
        own, told = number(place.named), walks.told[walks.told != UNKNOWN]
        if not len(told) or (told == own).mean() > RARE:
            return
        other = _most(told)
        if other or own in inside:  # `warnings` reports shapes that name no exterior
            there = f"name medium {self._names[other]}" if other else "name none"
            self.conflicts.append(
                f"{place.name} names medium {self._names[own]}, but the shapes around it {there} on that side: "
                "expected one medium"
            )


def _most(media: Array) -> int:
    """Return the medium that most walks find."""
    return int(np.bincount(media).argmax())


def _is_one_point(points: Array) -> bool:
    return bool(np.ptp(points, axis=0).max() <= 1e-6 * np.abs(points).max(initial=1e-30))


def places_of(plugin: Any) -> list[Place]:
    """Return the places where light paths of a Mitsuba scene begin, one for each emitter."""
    u, v = _samples()
    result = []
    for each in plugin.emitters():
        infinite = mi.has_flag(each.flags(), mi.EmitterFlags.Infinite)
        ray, _ = sampled_ray(each, u, v, entry_sphere(plugin) if infinite else None)
        name = (each.get_shape() or each).id() or each.class_name()
        place = place_of(f"emitter {name}", ray.o, ray.d, named_by(each))
        result.append(replace(place, infinite=infinite))
    return result


def place_of_sensor(plugin: Any) -> Place:
    """Return the place where camera paths of a Mitsuba sensor begin."""
    ray, _ = plugin.sample_ray_differential(Float(0), Float(0.5), *_samples(), True)
    return place_of(name_of(plugin), ray.o, ray.d, named_by(plugin))


def name_of(sensor: MiSensor) -> str:
    """Return the name of a Mitsuba sensor in messages."""
    return f"sensor {sensor.id() or sensor.class_name()}"


def _samples() -> tuple[Any, Any]:
    """Return samples for rays: two dimensions for the place, and two for the direction."""
    u, v = pairs(sobol_points(_WALKS, 0, (_WALKS,)))
    return mi.Point2f(u), mi.Point2f(v)


def named_by(plugin: MiEmitter | MiSensor) -> MiMedium | None:
    """Return the medium that an emitter or a sensor names: its shape's exterior, else its own."""
    shape = plugin.get_shape()
    outside = None if shape is None else shape.exterior_medium()
    return plugin.get_medium() if outside is None else outside


def place_of(name: str, origin: Any, direction: Any, named: MiMedium | None = None) -> Place:
    """Return the place of an emitter or a sensor: some of its rays, and their reverses."""
    wide = dr.zeros(Array3f, max(dr.width(origin), dr.width(direction)))
    origin, direction = (to_numpy(Array3f(each) + wide).T.astype(np.float64) for each in (origin, direction))
    good = np.isfinite(origin).all(axis=1) & np.isfinite(direction).all(axis=1) & (np.abs(direction).max(axis=1) > 0)
    origin, direction = origin[good], direction[good]
    chosen = np.unique(np.linspace(0, len(origin) - 1, _WALKS).astype(int)) if len(origin) else np.zeros(0, dtype=int)
    origin, direction = origin[chosen], direction[chosen]
    return Place(name, np.concatenate([origin, origin]), np.concatenate([direction, -direction]), named)
