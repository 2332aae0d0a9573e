"""Frames that reuse parts of an earlier frame of the same shot: those that an edit did not affect."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from .. import scene
from ..render.passes import Statistics
from ..render.reuse import Begun, Reuse
from ..render.stage_frame import begin
from ..scene.changes import equal
from ..transport.guiding.eye_points import is_room, surfaces_seen
from ..world.cameras.cameras import View

if TYPE_CHECKING:
    from ..render.films.frame_sums import FrameSums
    from ..render.frame import Lit, Seen
    from ..render.light import TracedLight
    from ..shot.request import Prepared

# The number of passes whose light and surfaces are kept, for the first pictures after an edit.
_KEPT = 1


class Cancelled(Exception):  # noqa: N818 - not an error: another picture is wanted
    """The frame is no longer wanted."""


class LiveFrame:
    """A frame of a stage that reuses the unchanged parts of an earlier frame.

    Its passes have the bits of those of `stage_frame.render`, unless it `keeps_guides`: then emission is guided as in
    the earlier frame, whatever has changed, for quick first pictures. After an edit of a look, large pictures keep the
    plan of samples that the earlier look had. Samples are chosen for the `planned` number of passes. `beside` is
    another frame whose world is used where it is the same, so that there is one at a time. Once the frame is
    `unwanted`, it ends with `Cancelled` before the next part of a phase.
    """

    _begun: Begun

    def __init__(
        self, ready: Prepared, planned: int | None, like: LiveFrame | None = None, keeps_guides: bool = False,
        beside: LiveFrame | None = None, unwanted: Callable[[], bool] = lambda: False,
    ) -> None:  # fmt: skip
        self._ready, self._shutter = ready, ready.content.shutter
        viewers = tuple(ready.content.viewers())
        self._lights: dict[int, Lit] = {}
        self._pictures: dict[tuple[int, int], Seen] = {}

        def interrupt() -> None:
            if unwanted():
                raise Cancelled

        earlier = None
        if like is not None:
            other = None if beside is None else beside._begun
            earlier = Reuse(like._begun, ready.settings, ready.window, viewers, keeps_guides, other)
        self._frame = begin(
            self._shutter, ready.window, ready.settings, ready.holdouts, lambda: viewers, planned,
            earlier=earlier, memory=weakref.proxy(self), interrupt=interrupt,
        )  # fmt: skip
        self._begun = Begun(self._frame.light, self._shutter, ready.window, planned, viewers)
        self._worlds = self._begun.worlds
        if like is not None and self._begun.lit_like(like._begun):
            self._lights = dict(like._lights)
            moving = self._shutter.moving or like._shutter.moving
            if not moving and equal(self._shutter.at(0.0).cameras, like._shutter.at(0.0).cameras):
                self._pictures = dict(like._pictures)

    @property
    def in_room(self) -> bool:
        """Whether the camera sees a room: see `eye_points.is_room`."""
        world = self._worlds.opened
        return is_room(world, surfaces_seen(world, self.view.projections))

    @property
    def view(self) -> View:
        """The camera when the shutter opens, and the whole picture."""
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

    def light(self, number: int, trace: Callable[[], Lit]) -> Lit:
        """Return the light of pass `number`: that which is kept, or else what `trace` returns."""
        if number not in self._lights:
            found = trace()
            if number < _KEPT:
                self._lights[number] = found
            return found
        light, photons = self._lights[number]
        return self._with_looks(light), photons

    def picture(self, numbers: range, view: int, see: Callable[[], Seen]) -> Seen:
        """Return what a view sees in passes, except beams: what is kept, or else what `see` returns."""
        key = numbers.start, view
        if key in self._pictures:
            return self._pictures[key]
        found = see()
        if numbers.stop <= _KEPT:
            self._pictures[key] = found
        return found
