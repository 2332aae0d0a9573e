"""Which technique finds which light of which emitter: one table for all kinds of light path.

`Kind` has the kinds, as docs/theory.md, "Which light is found how". A kind is found by the first of its techniques
that can find it for an emitter and is not switched off; if all that can are off, by the first that can. An emitter's
record, a `Row`, says which that is; what light paths are traced for it, and which walks meet it, follows from that.

A light path is read from the camera E to the emitter L, with S for mirrors and glass, D for surfaces that scatter light
otherwise, and M for media. The camera path itself finds what has neither D nor M. Mirrors hide nothing from walks to
wide emitters, such as skies: their light beside mirrors is of the kinds "further".
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, fields
from enum import Enum, StrEnum
from functools import cached_property, reduce
from operator import or_

import numpy as np

from .. import scene
from ..transport.segments.records import Counts
from ..transport.strata import wanted
from ..transport.tuning import Tuning
from ..world.emitters.emitter import Emitter, Links
from ..world.media.rendered import RenderedMedium
from ..world.world import World


class Technique(StrEnum):
    """What finds light."""

    SAMPLES = "direct samples"
    WALKS = "walks"
    PHOTONS = "photons"
    VIRTUAL = "virtual lights"
    BEAMS = "beams"
    SEGMENTS = "samples along the camera's segment"
    TALLY = "tally"


SAMPLES, WALKS, PHOTONS, VIRTUAL, BEAMS, SEGMENTS, TALLY = Technique

# An emitter lights little if it lights less than this fraction of the surfaces in the picture; and media openly if
# nothing is in the way of at least this fraction of the lines to them.
_LITTLE, _OPEN = 0.2, 0.5

#: The techniques that each `Settings.method` switches off.
METHODS: dict[str, set[str]] = {"auto": set(), "beams": {WALKS, TALLY}, "paths": {BEAMS}}


class Kind(Enum):
    """A kind of light path: its path from the camera, what finds it, and which light of light paths brings it.

    Attributes
    ----------
    title, path, said
        What it is called, its path, and the techniques in words: the first one first, "else" before others, "and"
        between those whose weights add up to one.
    found
        The techniques as sets.
    traced
        Which light of light paths is of this kind.
    """

    STRAIGHT = "straight to surfaces", "E S* D L", "direct samples, else photons", Counts.DIRECT_PHOTONS
    FURTHER = "further to surfaces", "E S* D … L", "walks, else photons", Counts.PHOTONS
    SELDOM = (
        "further to surfaces, seldom seen", "E S* D … D D L, L small", "walks and virtual lights, else walks",
        Counts.DIRECT_PHOTONS,
    )  # fmt: skip
    CAUSTICS = "caustics on surfaces", "E S* D … S L, L small", "photons, else walks", Counts.CAUSTIC_PHOTONS
    FOG = "straight to media", "E S* M L", "beams, else walks", Counts.DIRECT_BEAMS
    SKIES = (
        "skies, straight to media", "E S* M L, L a sky",
        "samples along the camera's segment, else beams, else walks", Counts.DIRECT_BEAMS,
    )  # fmt: skip
    FOG_FURTHER = "further to media", "E M … L", "tally, else beams, else walks", Counts.BEAMS
    MIRRORED = "further to media, in mirrors", "E S S* M … L", "beams, else walks", Counts.BEAMS
    FOG_CAUSTICS = "by mirrors to media", "E S* M … S L, L small", "beams", Counts.CAUSTIC_BEAMS

    def __init__(self, title: str, path: str, said: str, traced: Counts) -> None:
        self.title, self.path, self.said, self.traced = title, path, said, traced
        self.found = [{Technique(each) for each in part.split(" and ")} for part in said.split(", else ")]


STRAIGHT, FURTHER, SELDOM, CAUSTICS, FOG, SKIES, FOG_FURTHER, MIRRORED, FOG_CAUSTICS = Kind


@dataclass(frozen=True)
class Row:
    """Which techniques find the light of the emitter with a number, by the kinds of light path that it has.

    In the media with the names `thick`, walks find its light instead. Where its light comes through `narrow` openings,
    light paths tell where they are, also if they carry no light.
    """

    number: int
    found: Mapping[Kind, set[Technique]]
    thick: frozenset[str] = frozenset()
    narrow: bool = False

    def by(self, technique: Technique, kind: Kind) -> bool:
        """Return whether a technique finds a kind of light path."""
        return technique in self.found.get(kind, ())

    @property
    def walked(self) -> bool:
        """Whether walks find the emitter's light in any media."""
        return self.by(WALKS, FOG) or bool(self.thick)

    @property
    def counts(self) -> Counts:
        """Which of the emitter's light is traced."""
        traced = {PHOTONS, VIRTUAL, BEAMS}
        found = reduce(or_, (kind.traced for kind, own in self.found.items() if own & traced), Counts.NOTHING)
        return found | (Counts.TALLIED if self.by(TALLY, FOG_FURTHER) else Counts.NOTHING)

    @property
    def guided(self) -> Counts:
        """Which light guides light paths.

        Virtual lights go where photons would be to which they send light, unless there are beams: these need all guides
        that they can get, through a hole if there is one. Light paths of a tally go everywhere.
        """
        alone = SELDOM in self.found and not self.by(BEAMS, FOG)
        virtual = FURTHER.traced | SELDOM.traced if alone else Counts.NOTHING
        return self.counts & ~Counts.TALLIED | virtual | (FOG.traced if self.narrow else Counts.NOTHING)


@dataclass(frozen=True)
class SeenLight:
    """What the first camera sees of the light of emitters, by their numbers, where the pilot has looked.

    Attributes
    ----------
    lit
        The fraction of the surfaces in the picture that an emitter lights.
    free
        The fraction of the lines from an emitter to fog in the picture in whose way nothing is.
    """

    lit: Mapping[int, float] = field(default_factory=dict)
    free: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Techniques:
    """The choice of techniques for the emitters of a world.

    Attributes
    ----------
    world, tuning
        The world, and how light paths are traced in it.
    off
        Techniques that are not to be used.
    seen
        What the pilot knows of the emitters' light: see `rare` and `free`.
    """

    world: World
    tuning: Tuning
    off: Set[str]
    seen: SeenLight = SeenLight()

    @cached_property
    def rows(self) -> list[Row]:
        """The rows of all emitters, by number."""
        return [self._row(each) for each in range(len(self.world.emitters))]

    @cached_property
    def free(self) -> list[int]:
        """The numbers of the emitters whose light in media either walks or beams may find: in fog of a stage, beams."""
        chosen = {WALKS, BEAMS} & self.off or (self.world.hazy and not self.world.emits)
        return [] if chosen else self._plain

    def _walks_first(self, number: int) -> bool:
        """Return whether walks are tried first for the light of an emitter in media.

        Near a lamp in fog beams have far less noise than walks, as where the light comes through openings, which walks
        do not know, and where mirrors turn it. The beams of skies are wide and bring too much; those of suns do not
        begin in all endless fog.
        """
        world = self.world
        if number not in self.free:
            return False
        if not world.hazy:
            return world.emits or self.tuning.scatters
        if not world.emitters[number].lamp.bare.sharp or world.short_of_fog([number]):
            return True
        open_sun = world.emitters[number].lamp.infinite and self.seen.free.get(number, 0.0) >= _OPEN
        return open_sun and not world.mirrors

    def _choose(self, kind: Kind, able: set[Technique], walked: bool = False) -> set[Technique]:
        """Return the techniques that find a kind of light path, of those that can; walks first where it is `walked`."""
        can = [each for each in kind.found if each <= able][:: -1 if walked else 1]
        return next((each for each in can if not each & self.off), can[0])

    def _row(self, number: int) -> Row:
        """Return the row of an emitter."""
        world, emitter = self.world, self.world.emitters[number]
        own, lamp, thick = emitter.beams, emitter.lamp.bare, self._thick.get(number, frozenset())
        everywhere = self._walks_first(number) or (bool(thick) and thick == world.numbers.keys())
        fog = self._choose(FOG_FURTHER, {BEAMS, WALKS} if number in self._plain else {BEAMS}, everywhere)
        is_sky = own.lights_media and not own.emits_beams and own.shines and world.media.all
        further = self._choose(FOG_FURTHER, fog | ({TALLY} if BEAMS in fog and self._tallied(number) else set()))
        found = {FOG_FURTHER: further, **({SKIES: {SEGMENTS}} if is_sky else {FOG: fog})}
        shown = wanted(world, emitter, self.tuning)
        if STRAIGHT.traced & shown:
            found[STRAIGHT] = self._straight[number]
        if FURTHER.traced & shown:
            found[FURTHER] = self._further(number)
            if number in self.rare and self.seen.lit.get(number, 1.0) < _LITTLE:
                found[SELDOM] = self._choose(SELDOM, {WALKS, VIRTUAL})
        if world.mirrors:
            found[MIRRORED] = fog
        if world.mirrors and lamp.sharp:
            found[FOG_CAUSTICS] = {BEAMS}
            if FURTHER in found:
                found[CAUSTICS] = self._choose(CAUSTICS, {PHOTONS} | (found[FURTHER] if lamp.met else set()))
        narrow = WALKS in fog and not lamp.sharp and self.seen.free.get(number, 1.0) < _OPEN
        return Row(number, found, frozenset() if WALKS in fog else thick, narrow)

    def _tallied(self, number: int) -> bool:
        """Return whether the tally can find the light of an emitter further in media.

        It is seen by the camera's own rays alone.
        """
        own = self.world.sources[self.world.emitters[number].source]
        physical = own.scattered == "physical" or (own.look is None and own.scattered != "off")
        if TALLY in self.off or not self.tuning.visible:
            return False
        return physical and not self.tuning.short and not self._thick.get(number)

    @cached_property
    def _straight(self) -> list[set[Technique]]:
        """What finds light straight from emitters on surfaces, by number.

        Photons carry no light of links and none past portals, and endless fog dims what comes from infinity.
        """
        result = []
        for emitter in self.world.emitters:
            dimmed = emitter.lamp.infinite and self.world.media.filling > 0
            cannot = dimmed or emitter.portal or emitter.links != Links() or emitter.beams.beam_count == 0
            found = self._choose(STRAIGHT, {SAMPLES} if cannot else {SAMPLES, PHOTONS})
            result.append(found if emitter.lamp.illuminates else {PHOTONS})
        return result

    def _further(self, number: int) -> set[Technique]:
        """Return what finds the light of an emitter further on surfaces.

        Walks cannot if it shines along one direction, or if some surfaces do not block it. What they find of an emitter
        includes the light straight to their vertices.
        """
        meets = not self.world.emitters[number].links.unshadowed and SAMPLES in self._straight[number]
        return self._choose(FURTHER, {PHOTONS, WALKS} if meets else {PHOTONS})

    @cached_property
    def rare(self) -> list[int]:
        """The numbers of the emitters whose light on surfaces becomes virtual lights if it is seldom seen: see `_row`.

        They are sharp, and found by walks. Paths past a portal may not be traced. Photons that come straight from an
        emitter are no virtual lights, so if any do there are none. Endless fog dims light from infinity on its way from
        the bounds, but not direct light on surfaces: see `VirtualLights`, which cannot tell if other media are in it.
        """
        media, result = self.world.media, []
        for number, each in enumerate(self.world.emitters):
            mixed = each.lamp.infinite and media.filling > 0 and self.world.nested
            able = each.lamp.bare.sharp and each.portal is None and each.links == Links() and not mixed
            shown = FURTHER.traced & wanted(self.world, each, self.tuning)
            if able and shown and WALKS in self._further(number):
                result.append(number)
        return result if all(SAMPLES in each for each in self._straight) else []

    @property
    def hidden(self) -> list[int]:
        """The numbers of the emitters of which it matters what is in the way of their light to fog.

        They are skies, and suns where no mirror turns their light: see `_walks_first`.
        """
        world = self.world
        lamps = {each: world.emitters[each].lamp.bare for each in (self.free if world.hazy else ())}
        return [each for each, lamp in lamps.items() if not lamp.sharp or (lamp.infinite and not world.mirrors)]

    @cached_property
    def _plain(self) -> list[int]:
        """The numbers of the emitters whose light in media walks can find.

        They light everything from all around, and have no settings of their beams but a group. Programs and files of
        beams want all beams.
        """
        if self.tuning.short or not (self.tuning.surfaces and self.tuning.visible):
            return []
        return [number for number, each in enumerate(self.world.emitters) if _is_unset(each)]

    @cached_property
    def _thick(self) -> dict[int, frozenset[str]]:
        """The names of the thick media in which walks find the light of emitters, by the numbers of these.

        What mirrors and glass turn is always traced, and beams carry the light before and after that.
        """
        world, result = self.world, {}
        thick = [] if world.mirrors or WALKS in self.off else self.tuning.thick(world)
        names = {number: name for name, number in world.numbers.items()}
        thick = [each for each in thick if each.number in names]  # of media with one name, only the last is known by it
        for each in self._plain if thick else ():
            result[each] = frozenset(names[medium.number] for medium in thick if self._finds(each, medium))
        return result

    def _finds(self, number: int, medium: RenderedMedium) -> bool:
        """Return whether walks find an emitter's light in a medium.

        They look around a lamp, and not along its cone: beams find that of a lamp with a cone in the medium, or nearer
        to it than this is wide.
        """
        light, (low, high) = self.world.emitters[number].beams, self.world.boxes[medium.number]
        if not isinstance(light, scene.Light) or light.shaping is None or self.world.emitters[number].lamp.infinite:
            return True
        gaps = np.linalg.norm(light.points - np.clip(light.points, low, high), axis=1)
        return bool((gaps > self.world.radius_of(medium)).all())


def _is_unset(emitter: Emitter) -> bool:
    """Return whether an emitter lights everything from all around, and its beams have no settings but a group."""
    own, usual = emitter.beams, scene.BeamSettings()
    said = {each.name for each in fields(usual) if getattr(own, each.name) != getattr(usual, each.name)}
    unset = said <= {"group"} and own.lights_surfaces and emitter.lamp.illuminates
    return unset and emitter.links == Links() and not getattr(own, "guides", ())
