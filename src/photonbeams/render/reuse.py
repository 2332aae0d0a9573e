"""What a frame takes over from an earlier one of the same shot: worlds, results of pilots, and the light of passes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import drjit as dr

from .. import scene
from ..scene.changes import equal
from ..world.cameras.cameras import Window
from ..world.shutter import Shutter
from ..world.world import World
from .settings import Settings, as_passes
from .stage_frame import begin

if TYPE_CHECKING:
    from .frame import FrameRenderer, Lit, Seen
    from .holdouts import HoldoutDepth
    from .light import ShotLight
    from .pilots.pilot import Findings
    from .worlds import ShutterWorlds

# Beams and photons that are kept for the next frame of a film, about 200 bytes each.
_MOST_RECORDS = 1 << 21


class Begun(NamedTuple):
    """A frame that was begun: its light, and what it was begun with.

    `planned` is the number of passes, or None; `viewers` are the cameras of all frames of its shot.
    """

    light: ShotLight
    shutter: Shutter
    window: Window
    planned: int | None
    viewers: tuple[scene.Camera, ...]

    @property
    def worlds(self) -> ShutterWorlds:
        """Its worlds over the shutter interval."""
        return cast("ShutterWorlds", self.light.worlds)

    @property
    def light_side(self) -> frozenset[str] | None:
        """The names of the lights that are seen past their portals."""
        past = self.light.simulation.allotment.past
        return None if past is None else frozenset(past)

    def lit_like(self, other: Begun) -> bool:
        """Return whether each pass has the same light paths as in another frame."""
        rests = all(not each.shutter.moving or each.shutter.unchanging for each in (self, other))
        if not rests or self.light.settings.program is not None or self.window != other.window:
            return False
        guided = self.light.simulation.guides is other.light.simulation.guides
        same = guided and self.light_side == other.light_side and self.planned == other.planned
        return same and _same_light(self.light.settings, self.worlds.known[-1], other)


class Reuse:
    """What a frame with other settings, window and viewers takes over: see `stage_light.Earlier`.

    If it `keeps_guides`, light is guided as in the earlier frame, whatever has changed. Where `beside` is a frame that
    has more of the scene, its world is taken over.
    """

    def __init__(
        self, known: Begun, settings: Settings, window: Window, viewers: Sequence[scene.Camera],
        keeps_guides: bool = False, beside: Begun | None = None,
    ) -> None:  # fmt: skip
        self.worlds: Sequence[World] = (beside or known).worlds.known[-1:]
        self.light_side = known.light_side if keeps_guides else None
        self._known, self._settings, self._keeps_guides = known, settings, keeps_guides
        # Guides depend on the whole picture, not on the crop.
        self._same_views = window.whole() == known.window.whole() and equal(tuple(viewers), known.viewers)

    def findings(self, world: World, light_side: frozenset[str]) -> Findings | None:
        """Return what the earlier frame's pilots found; None if it has to be found again."""
        same = self._same_views and light_side == self._known.light_side
        if not self._keeps_guides and not (same and _same_light(self._settings, world, self._known)):
            return None
        return self._known.light.findings


class FilmMemory:
    """What frames of a film have in common, while only cameras move: the world, guides, and the light of passes.

    A frame has the same bits with and without it. Nothing is kept of a scene that changes, whose surfaces would be in
    the kernels of later ones.
    """

    def __init__(self) -> None:
        self._last: Begun | None = None
        self._light: dict[int, Lit] = {}

    def begin(
        self, shutter: Shutter, window: Window, settings: Settings, holdouts: Sequence[HoldoutDepth],
        viewers: Callable[[], Sequence[scene.Camera]] | None, planned: int | None,
    ) -> FrameRenderer:  # fmt: skip
        """Return what `stage_frame.begin` does, with what is known from the last frame."""
        last, cameras, earlier = self._last, tuple(viewers() if viewers else shutter.at(0.0).cameras), None
        rests = (shutter.unchanging or not shutter.moving) and settings.program is None
        if last is not None and rests and equal(last.shutter.at(0.0).scene, shutter.at(0.0).scene, rounding=0.0):
            known = last.shutter.at(0.0).scene
            shutter = shutter.with_scenes(lambda _: known)
            earlier = Reuse(last, settings, window, cameras)
        else:
            self._last, self._light, last = None, {}, None  # before another world is built
        memory = _KeptLight(keeps=rests)
        frame = begin(shutter, window, settings, holdouts, lambda: cameras, planned, earlier=earlier, memory=memory)
        own = Begun(frame.light, shutter, window, planned, cameras)
        if last is not None and own.lit_like(last):
            memory.found = self._light
        self._last, self._light = (own if rests else None), memory.found
        return frame


class _KeptLight:
    """The light of the passes of a frame, kept for other frames: see `frame.PassMemory`."""

    def __init__(self, keeps: bool) -> None:
        self.found: dict[int, Lit] = {}
        self._keeps = keeps

    def light(self, number: int, trace: Callable[[], Lit]) -> Lit:
        """Return the light of pass `number`: that which is kept, or else what `trace` returns."""
        if number in self.found:
            return self.found[number]
        result = trace()
        if self._keeps and sum(map(_records, (*self.found.values(), result))) <= _MOST_RECORDS:
            self.found[number] = result
        return result

    def picture(self, numbers: range, view: int, see: Callable[[], Seen]) -> Seen:
        """Return what `see` returns: cameras move."""
        return see()


def _records(lit: Lit) -> int:
    """Return how many beams and photons a pass has."""
    light, _ = lit
    return sum(len(each.beams) for each in light.sets) + sum(dr.width(each.position) for each in light.hits)


def _same_light(settings: Settings, world: World, like: Begun) -> bool:
    """Return whether a world and an earlier one have the same lights, media, surfaces and settings but for looks."""
    if as_passes(settings) != as_passes(like.light.settings):
        return False
    own, other = world.parts.given, like.worlds.known[-1].parts.given
    if own is other:
        return True
    rest = [each.name for each in fields(own) if each.name not in ("lights", "drawn")]
    makers = (own.lights, other.lights), (own.drawn, other.drawn)
    return all(equal(getattr(own, name), getattr(other, name)) for name in rest) and all(
        len(mine) == len(theirs) and all(map(_but_for_looks, mine, theirs)) for mine, theirs in makers
    )


def _but_for_looks(one: Any, other: Any) -> bool:
    """Return whether two lights or sets of drawn beams differ at most in their looks; either both have one or none."""
    if type(one) is not type(other) or (one.look is None) != (other.look is None):
        return False
    return all(equal(getattr(one, each.name), getattr(other, each.name)) for each in fields(one) if each.name != "look")
