"""Frames that reuse parts of an earlier frame of the same shot: those that an edit did not affect."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, cast

from .. import scene
from ..render.passes import Statistics
from ..render.pilots.choice import is_room
from ..render.settings import Settings, as_passes
from ..render.stage_frame import begin
from ..usd.common.motion import equal
from ..world.cameras.cameras import View
from ..world.world import World

if TYPE_CHECKING:
    from ..estimators.projection import Projection
    from ..render.films.frame_sums import FrameSums
    from ..render.frame import Lit, Seen
    from ..render.light import ShotLight, TracedLight
    from ..render.lights import Findings
    from ..render.worlds import ShutterWorlds
    from ..shot.request import Prepared

# The number of passes whose light and surfaces are kept, for the first pictures after an edit.
_KEPT = 1


class Cancelled(Exception):  # noqa: N818 - not an error: another picture is wanted
    """The frame is no longer wanted."""


class LiveFrame:
    """A frame of a stage that reuses the unchanged parts of an earlier frame.

    Its passes have the bits of those of `stage_frame.render`, unless it `keeps_guides`: then emission is guided as in
    the earlier frame, whatever has changed, for quick first pictures. Samples are chosen for the `planned` number of
    passes. Once it is `unwanted`, it ends with `Cancelled` before the next part of a phase.
    """

    def __init__(
        self, ready: Prepared, planned: int | None, like: LiveFrame | None = None, keeps_guides: bool = False,
        unwanted: Callable[[], bool] = lambda: False,
    ) -> None:  # fmt: skip
        self._ready, self._shutter = ready, ready.content.shutter
        viewers = self._viewers = tuple(ready.content.viewers())
        self._lights: dict[int, Lit] = {}
        self._pictures: dict[tuple[int, int], Seen] = {}

        def interrupt() -> None:
            if unwanted():
                raise Cancelled

        earlier = None if like is None else _Reuse(like, self, keeps_guides)
        self._frame = begin(
            self._shutter, ready.window, ready.settings, ready.holdouts, lambda: viewers, planned,
            earlier=earlier, memory=weakref.proxy(self), interrupt=interrupt,
        )  # fmt: skip
        self._emission = cast("ShotLight", self._frame.light)
        self._worlds = cast("ShutterWorlds", self._emission.worlds)
        if like is not None and self._lit_like(like) and planned == like._frame.planned:
            self._lights = dict(like._lights)
            if equal(self._shutter.at(0.0).cameras, like._shutter.at(0.0).cameras):
                self._pictures = dict(like._pictures)

    @property
    def in_room(self) -> bool:
        """Whether the camera sees a room: see `choice.is_room`."""
        return is_room(self._worlds.opened, self._view)

    @property
    def _view(self) -> View:
        return View(self._shutter.at(0.0).cameras[0], self._ready.window.whole())

    @property
    def statistics(self) -> Statistics:
        """The statistics so far."""
        return self._frame.statistics

    def add_pass(self, number: int) -> None:
        """Add pass `number`."""
        self._frame.add_pass(number)

    def sums(self) -> FrameSums:
        """Return the sums of the passes so far."""
        return self._frame.sums()

    def first_light(self) -> TracedLight | None:
        """Return the light of the first pass; None if it was not traced yet, or if anything moves."""
        return self._with_looks(self._lights[0][0]) if 0 in self._lights else None

    def _with_looks(self, light: TracedLight) -> TracedLight:
        """Return the light of an earlier frame with the looks of this one."""
        looks = self._shutter.at(0.0).scene.looks()
        return replace(light, sets=[each._replace(look=looks.get(each.name)) for each in light.sets])

    def described_media(self) -> dict[int, scene.Medium]:
        """Return the media by the numbers by which beams refer to them."""
        world = self._worlds.known[-1]
        both = zip(world.parts.content.media, world.media.all, strict=True)
        return {rendered.number: described for described, rendered in both}

    def projection(self) -> Projection:
        """Return how the whole picture is projected."""
        return self._view.projection

    def _lit_like(self, like: LiveFrame) -> bool:
        """Return whether each pass has the same light paths as in an earlier frame."""
        own, other = self._emission, like._emission
        if self._shutter.moving or own.settings.program is not None or self._ready.window != like._ready.window:
            return False
        guided = own.simulation.guides is other.simulation.guides
        same_side = own.simulation.allotment.past == other.simulation.allotment.past
        return guided and same_side and _same_light(own.settings, self._worlds.known[-1], like)

    def light(self, number: int, trace: Callable[[], Lit]) -> Lit:
        """Return the light of pass `number`: that which is kept, or else what `trace` returns."""
        if number not in self._lights:
            found = trace()
            if number < _KEPT:
                self._lights[number] = found
            return found
        light, photons = self._lights[number]
        light = self._with_looks(light)
        self.statistics.beams += sum(len(each.beams) for each in light.sets)
        return light, photons

    def picture(self, numbers: range, view: int, see: Callable[[], Seen]) -> Seen:
        """Return what a view sees in passes, except beams: what is kept, or else what `see` returns."""
        key = numbers.start, view
        if key in self._pictures:
            return self._pictures[key]
        found = see()
        if numbers.stop <= _KEPT:
            self._pictures[key] = found
        return found


class _Reuse:
    """What a frame takes over from an earlier one: see `render.stage_light.Earlier`."""

    def __init__(self, like: LiveFrame, frame: LiveFrame, keeps_guides: bool) -> None:
        past = like._emission.simulation.allotment.past
        self.worlds = like._worlds.known[-1:]
        self.light_side = frozenset(past) if keeps_guides and past is not None else None
        self._known, self._keeps_guides, self._settings = like, keeps_guides, frame._ready.settings
        own, other = frame._ready.window, like._ready.window
        # Guides depend on the size of the whole picture, not on the crop.
        same_size = (own.width, own.height) == (other.width, other.height)
        self._same_views = same_size and equal(frame._viewers, like._viewers)

    def findings(self, world: World) -> Findings | None:
        """Return what the earlier frame's pilots found; None if it has to be found again."""
        if not self._keeps_guides and not (self._same_views and _same_light(self._settings, world, self._known)):
            return None
        return self._known._emission.findings


def _same_light(settings: Settings, world: World, like: LiveFrame) -> bool:
    """Return whether a world and an earlier one have the same lights, media, surfaces and settings but for looks."""
    if as_passes(settings) != as_passes(like._emission.settings):
        return False
    own, other = world.parts.content, like._worlds.known[-1].parts.content
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
