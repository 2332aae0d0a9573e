"""Random walks through a Mitsuba scene, which find out which medium is where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ....numerics.arrays import to_float, to_vectors
from ....runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ....scene import Array
from ...shadow_rays import leaving
from ..interfaces import UNKNOWN, meet, reflected

if TYPE_CHECKING:
    from ....runtime.mitsuba_types import MiScene

mi = mitsuba()

# Number of steps of a walk.
_STEPS = 12
# Kinds of walks. ASKING ones pass surfaces that transmit light and name no media; CROSSING ones pass half of the
# interfaces, too; ONWARD ones pass everything but interfaces.
ASKING, CROSSING, ONWARD = 0, 1, 2


@dataclass
class Walks:
    """Hits of walks, (steps, N); `near` and `far` are the media that an interface names, UNKNOWN elsewhere."""

    alive: Array
    valid: Array
    crossed: Array
    near: Array
    far: Array
    shape: Array
    start: Array
    end: Array

    def part(self, begin: int, end: int | None) -> Walks:
        """Return the walks from number `begin` to `end`."""
        return Walks(*(getattr(self, name)[:, begin:end] for name in self.__dataclass_fields__))

    def steps(self) -> Iterator[Walks]:
        """Yield the steps one by one."""
        for each in range(len(self.alive)):
            yield Walks(*(getattr(self, name)[each] for name in self.__dataclass_fields__))


def walk(plugin: MiScene, origin: Array, direction: Array, rng: np.random.Generator, kind: int, size: Float) -> Walks:
    """Return random walks of a kind (`ASKING`, `CROSSING`, `ONWARD`) in a scene with the diameter `size`."""
    count = len(origin)
    here, along, alive = to_vectors(origin), to_vectors(direction), dr.full(Bool, True, count)
    crossing, onward = dr.opaque(Float, 0.5 if kind == CROSSING else -1.0), dr.opaque(Bool, kind == ONWARD)
    rows: dict[str, list[Array]] = {name: [] for name in Walks.__dataclass_fields__}
    for _ in range(_STEPS):
        aside, threshold = to_vectors(random_directions(rng, count)), to_float(rng.random(count))
        met = meet(plugin, here, along, alive)
        valid = alive & met.hit.is_valid()
        through = valid & (met.transmits | onward) & (~met.interface | (threshold < crossing))
        following = dr.select(through, along, reflected(met.hit, along, aside))
        spawned = leaving(met.hit, following, size)
        shape = dr.select(valid, UInt32(dr.reinterpret_array(mi.UInt32, met.hit.shape)), 0)
        values = {
            "alive": alive, "valid": valid, "crossed": through & met.interface, "near": met.near, "far": met.far,
            "shape": shape, "start": here, "end": Array3f(met.hit.p),
        }  # fmt: skip
        dr.eval(values, following, spawned)
        for name, value in values.items():
            rows[name].append(value.numpy().T if name in ("start", "end") else value.numpy())
        here, along, alive = spawned, following, valid
    columns = {name: np.array(row) for name, row in rows.items()}
    for name in ("near", "far", "shape"):
        columns[name] = columns[name].astype(np.int64)
    return Walks(**columns)


def first_interface(walks: Walks) -> tuple[Array, Array, Array]:
    """Return the media before and behind the first interface of each walk (UNKNOWN without one), and its shape."""
    met = walks.valid & (walks.near != UNKNOWN)
    step, lane = met.argmax(axis=0), np.arange(met.shape[1])
    some = met.any(axis=0)
    near, far, shape = (each[step, lane] for each in (walks.near, walks.far, walks.shape))
    return np.where(some, near, UNKNOWN), np.where(some, far, UNKNOWN), np.where(some, shape, 0)


def named_medium(walks: Walks) -> Array:
    """Return the first medium that each walk finds on the near side of an interface; 0 if there is none."""
    met = walks.valid & (walks.near != UNKNOWN) & (walks.near > 0)
    step, lane = met.argmax(axis=0), np.arange(met.shape[1])
    return np.where(met.any(axis=0), walks.near[step, lane], 0)


def known_media(walks: Walks, everywhere: int) -> Array:
    """Return the media in which walks began, for walks that find out: a named one, the background's, or none (0)."""
    escaped = (walks.alive & ~walks.valid).any(axis=0)
    named, empty = named_medium(walks), first_interface(walks)[0] == 0
    told = np.where(named > 0, named, np.where(escaped, everywhere, np.where(empty, 0, UNKNOWN)))
    result: Array = told[told != UNKNOWN]
    return result


def random_directions(rng: np.random.Generator, count: int) -> Array:
    """Return random unit vectors, (count, 3), uniform over the sphere."""
    return normalized(rng.normal(size=(count, 3)))


def normalized(vectors: Array) -> Array:
    """Return vectors, (N, 3), scaled to length 1."""
    result: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
    return result
