"""The strata of a world's emission: how many light paths each emitter sends, through its portal and past it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..numerics.arrays import to_numpy
from ..numerics.hashing import key_of
from ..numerics.sampling import pairs, sobol_points
from ..scene import DEFAULT_BEAMS, Array
from ..world.emitters.emitter import Emitter
from ..world.emitters.lamp import Lamp
from ..world.emitters.portals import count_candidates
from ..world.world import World
from .emission import PROBE, PathEmitter, Stratum
from .segments.records import Counts
from .tuning import Tuning

# The fraction of a lamp's beams that do not go through its portal, if such beams are seen.
LIGHT_SIDE = 0.25

# The fraction of these that pass close by the portal, if light is scattered more than once.
SURROUND = 0.25

# Most candidates for each path that passes its lamp's images, and most candidates of a stratum.
_MOST_DARK, _MOST_PATHS = 64, 1 << 22

# The least fraction of shared light paths that an emitter with any power gets.
_LEAST = 1 / 64

_PORTAL, _ALL = 0, 1  # kinds of strata, as part of the seeds of their sequences


@dataclass(frozen=True)
class Allotment:
    """How many light paths the emitters of a world send in a pass, unless their own settings say it.

    Attributes
    ----------
    count, shared
        The number of each emitter or, if it is `shared`, of all together, which divide it by their power.
    walks
        About how many walks of the tally there are, those of all emitters together.
    past
        Names of emitters whose paths past their portal are wanted, too (see `guiding.lines`); None: of all.
    counts
        Which light of emitters counts, by their numbers; all light of those that are not named.
    """

    count: int = DEFAULT_BEAMS
    shared: bool = False
    walks: int = 1 << 17
    past: Collection[str] | None = frozenset()
    counts: Mapping[int, Counts] = field(default_factory=dict)

    def strata(self, world: World, tuning: Tuning) -> list[Stratum]:
        """Return the strata of the emitters whose light is wanted.

        An emitter without a portal has one stratum, with all its directions. An emitter with a portal has two that add
        up to its light: the paths through the portal and, if they are wanted, all others.
        """
        parts = {}
        for number, emitter in enumerate(world.emitters):
            shown = self.counts.get(number, Counts.ALL) & wanted(world, emitter, tuning)
            if emitter.beams.beam_count != 0 and shown:
                parts[number] = self._parts(world, number, shown)
        if not self.shared:
            counts: Mapping[int, float] = dict.fromkeys(parts, self.count)
        else:
            parts = {number: [each for each in own if max(each[0].flux) > 0] for number, own in parts.items()}
            counts = self._divided(parts)
        names = Counter(each.name for each in world.emitters)
        result = []
        for number, own in parts.items():
            emitter, whole = world.emitters[number], sum(share for _, share in own)
            said = emitter.beams.beam_count
            # The light of one emitter does not change with the number of others, which may have the same name.
            key = key_of(emitter.name) if names[emitter.name] == 1 else key_of(emitter.name, number)
            for part, share in own:
                count = round((counts[number] if said is None else said) * share / whole)
                if count > 0 or self.shared:
                    kind = _PORTAL if part.through else _ALL
                    sequence = (tuning.seed & 0xFFFFFFFF, emitter.beams.seed & 0xFFFFFFFF, kind, key)
                    fixed = said is not None or not self.shared
                    result.append(_stratum(part, max(count, 1), tuning, sequence, fixed))
        return result

    def _parts(self, world: World, number: int, shown: Counts) -> list[tuple[PathEmitter, float]]:
        """Return an emitter's light as a whole, or through its portal and past it, and the fractions of its paths."""
        emitter, whole = world.emitters[number], PathEmitter(world, number, counts=shown)
        if emitter.portal is None:
            return [(whole, 1.0)]
        through = whole.at(emitter.portal, True)
        if self.past is not None and emitter.name not in self.past:
            return [(through, 1.0)]
        return [(through, 1 - LIGHT_SIDE), (whole.at(emitter.portal, False), LIGHT_SIDE)]

    def _divided(self, parts: Mapping[int, Sequence[tuple[PathEmitter, float]]]) -> dict[int, float]:
        """Return the numbers of paths of emitters that share them by their power."""
        power = np.array([max(sum((each.flux for each, _ in own), np.zeros(3))) for own in parts.values()])
        fractions = np.where(power > 0, np.maximum(power / max(power.sum(), 1e-30), _LEAST), 0)
        fractions = self.count * fractions / max(fractions.sum(), 1e-30)
        return dict(zip(parts, fractions.tolist(), strict=True))


#: The usual number of each emitter.
ALLOTMENT = Allotment()


def wanted(world: World, emitter: Emitter, tuning: Tuning) -> Counts:
    """Return which light of an emitter shows anything: as visible beams, on surfaces, or scattered again.

    Domes that light media without beams make beams of their scattered light.
    """
    own, scatters = emitter.beams, tuning.scatters
    visible = own.emits_beams and (not tuning.visible or world.hazy or own.look is not None)
    lighting = tuning.surfaces and own.lights_surfaces and own.shines
    scattered = scatters and own.lights_media and own.shines and world.hazy
    result = Counts.NOTHING
    if visible or scattered:
        result |= Counts.DIRECT_BEAMS | Counts.BEAMS | Counts.CAUSTIC_BEAMS
    if scatters and (visible or scattered):
        result |= Counts.TALLIED
    if lighting:
        result |= Counts.DIRECT_PHOTONS
    if lighting and scatters:
        result |= Counts.PHOTONS | Counts.CAUSTIC_PHOTONS
    return result


def _stratum(
    emitter: PathEmitter, count: int, tuning: Tuning, sequence: tuple[int, ...], fixed: bool
) -> Stratum:  # fmt: skip
    """Return the stratum of an emitter's paths, of which about `count` carry light."""
    world, lamp = emitter.world, emitter.lamp
    radius = radius_from_infinity(lamp, count, tuning.overlap) if world.fringed else 0.0
    if radius:
        whole = PathEmitter(world, emitter.number, partial(tuning.bounds, radius), emitter.counts)
        emitter = whole if emitter.portal is None else whole.at(emitter.portal, emitter.through)
    most = max(count, min(_MOST_DARK * count, _MOST_PATHS))
    count = min(count_candidates(max(lit_fraction(emitter), 1 / _MOST_DARK), count), most)
    if emitter.through and emitter.portal is not None:
        count = count_candidates(emitter.portal.fill, count)
    return Stratum(emitter, count, sequence, fixed)


def radius_from_infinity(lamp: Lamp, count: int, overlap: float) -> float:
    """Return the radius of a lamp's beams in the middle of the world, in its radii, if they come from infinity; else 0.

    With the solid angle Ω of the lamp, N paths that begin on a disc of radius R have the radius r of `segments.radii`,

        r² = (overlap / 2)² · R² · max(π / N, 5/2 · √(π Ω / N)).
    """
    if not lamp.infinite:
        return 0.0
    return 0.5 * overlap * float(np.sqrt(max(np.pi / count, 2.5 * np.sqrt(2 * np.pi**2 * lamp.covered / count))))


def with_surrounds(strata: Sequence[Stratum]) -> list[Stratum]:
    """Split each stratum of paths past a portal into two: paths close by the portal, and all others.

    Only a little of the light hits the edges of a hole. But when it is scattered into the room, it matters as much as
    the light that passes the hole, so it needs paths of its own.
    """
    result = []
    for stratum in strata:
        emitter, count = stratum.emitter, round(SURROUND * stratum.count)
        if emitter.portal is None or emitter.through or emitter.lamp.images:
            result.append(stratum)
            continue
        surround = emitter.portal.surround
        if surround is None or count < 1:
            result.append(stratum)
            continue
        near = emitter.at(surround, True, without=emitter.portal)
        far = emitter.at(surround, False)
        result.append(Stratum(near, count, (*stratum.sequence, 4), stratum.fixed))
        result.append(Stratum(far, stratum.count - count, stratum.sequence, stratum.fixed, stratum.guide))
    return result


def lit_fraction(emitter: PathEmitter) -> float:
    """Return which fraction of the emitter's paths passes its images, estimated from a few; 1 without images."""
    lamp, through = emitter.lamp, emitter.through
    if not lamp.images:
        return 1.0
    if through not in lamp.lit:
        lamp.lit[through] = _lit(emitter, sobol_points(PROBE, 0, (PROBE,)))
    return lamp.lit[through]


def _lit(emitter: PathEmitter, points: Array) -> float:
    """Return the fraction of the paths with these emission samples that carry light, among those that exist."""
    probe = emitter.sample(*pairs(points))
    there = np.broadcast_to(probe.valid.numpy(), len(points))
    lit = there & (to_numpy(probe.flux).max(axis=0) > 0)
    return float(lit.sum() / max(there.sum(), 1))


def guided_count(stratum: Stratum) -> int:
    """Return the number of paths of a stratum of which as many carry light as if it were not guided.

    A guide sends paths to where images let light pass; those that others need to find these places would be too many.
    """
    if stratum.guide is None or not stratum.emitter.lamp.images:
        return stratum.count
    points = sobol_points(PROBE, 0, (PROBE,))
    before, behind = (_lit(stratum.emitter, each) for each in (points, stratum.guide(points)[0]))
    return max(round(stratum.count * min(before / max(behind, 1e-30), 1)), 1)


def redistributed(strata: Sequence[Stratum], seen: Sequence[float]) -> list[int]:
    """Return the numbers of paths of strata: of those that share paths half by power, half by the light that is `seen`.

    Strata whose number of paths is fixed keep it.
    """
    counts, free = [each.count for each in strata], [not each.fixed for each in strata]
    light = float(sum(own for own, shares in zip(seen, free, strict=True) if shares))
    if not light > 0:
        return counts
    total = sum(count for count, shares in zip(counts, free, strict=True) if shares)
    return [
        max(round(0.5 * count + 0.5 * own / light * total), 1) if shares else count
        for count, own, shares in zip(counts, seen, free, strict=True)
    ]
