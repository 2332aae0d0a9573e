"""Random walks through a Mitsuba scene, which find out which medium is where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ....numerics.arrays import to_vectors
from ....runtime.device import Array3f, Bool, Float, UInt32
from ....scene import Array
from ....scene.vectors import unit
from ...shadow_rays import leaving
from ..interfaces import UNKNOWN, meet, reflected

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import MiScene

# Number of steps of a walk.
_STEPS = 12


@dataclass
class Probes:
    """What walks found, (N,) each.

    Attributes
    ----------
    near, far
        The media before and behind the first interface; UNKNOWN where walks met none.
    named
        The first medium on the near side of an interface; 0 where there is none.
    escaped
        Whether walks left the scene.
    """

    near: Array
    far: Array
    named: Array
    escaped: Array

    def part(self, begin: int, end: int | None) -> Probes:
        """Return the walks from number `begin` to `end`."""
        return Probes(*(getattr(self, name)[begin:end] for name in self.__dataclass_fields__))

    @property
    def told(self) -> Array:
        """The media that interfaces name where walks began; UNKNOWN where they met none."""
        return np.where(self.named > 0, self.named, self.near)

    def known(self, everywhere: int) -> Array:
        """Return the media of walks that find out: a named one, the background's if they left the scene, or none."""
        told = np.where((self.named == 0) & self.escaped, everywhere, self.told)
        result: Array = told[told != UNKNOWN]
        return result


def walk(
    plugin: MiScene, origin: Array, direction: Array, rng: np.random.Generator, size: Float, onward: bool = False
) -> Probes:
    """Return random walks in a scene with the diameter `size`.

    Interfaces reflect walks, and so do surfaces that transmit no light, unless walks go `onward` through all of these.
    """
    count = len(origin)
    here, along, alive = to_vectors(origin), to_vectors(direction), dr.full(Bool, True, count)
    near, far, named = (dr.full(UInt32, each, count) for each in (UNKNOWN, UNKNOWN, 0))
    escaped, passing = dr.full(Bool, False, count), dr.opaque(Bool, onward)
    for _ in range(_STEPS):
        aside = to_vectors(random_directions(rng, count))
        met = meet(plugin, here, along, alive)
        valid = alive & met.hit.is_valid()
        first = met.interface & (near == UNKNOWN)
        near, far = dr.select(first, met.near, near), dr.select(first, met.far, far)
        named = dr.select(met.interface & (named == 0), met.near, named)
        escaped |= alive & ~valid
        along = dr.select((met.transmits | passing) & ~met.interface, along, reflected(met.hit, along, aside))
        here, alive = Array3f(leaving(met.hit, along, size)), valid
        dr.eval(here, along, alive, near, far, named, escaped)
    media: list[Array] = [each.numpy().astype(np.int64) for each in (near, far, named)]
    return Probes(media[0], media[1], media[2], escaped.numpy())


def random_directions(rng: np.random.Generator, count: int) -> Array:
    """Return random unit vectors, (count, 3), uniform over the sphere."""
    return unit(rng.normal(size=(count, 3)))
