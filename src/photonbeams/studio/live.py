"""Frames that reuse parts of an earlier frame of the same shot: those that an edit did not affect."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import drjit as dr

from .. import scene
from ..render.frame import Simulated, ViewRays
from ..render.passes import Statistics
from ..render.settings import as_passes
from ..render.stage_frame import StageRenderer
from ..transport.simulation import StageSimulation
from ..usd.common.motion import equal
from ..world.cameras.cameras import View
from ..world.stage_world import StageWorld

if TYPE_CHECKING:
    from ..estimators.tiles import Projection
    from ..render.film import Film
    from ..render.photons import PhotonLighting
    from ..shot.request import Prepared

# The number of passes whose light and surfaces are kept, for the first pictures after an edit.
_KEPT = 1


class Cancelled(Exception):  # noqa: N818 - not an error: another picture is wanted
    """The frame is no longer wanted."""


@dataclass
class _Cancellable(Statistics):
    """Statistics that cancel a frame between two phases, or parts of a phase, once it is `unwanted`."""

    unwanted: Callable[[], bool] = field(default=lambda: False, repr=False)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time within the context to a phase; before it, raise Cancelled if the frame is unwanted."""
        self.step()
        with super().phase(name):
            yield

    def step(self) -> None:
        """Wait for the frame's kernels, so that the next frame need not; then raise Cancelled if it is unwanted."""
        dr.sync_thread()
        if self.unwanted():
            raise Cancelled


class LiveRenderer(StageRenderer):
    """A frame of a stage that reuses the unchanged parts of an earlier frame.

    Its passes have the bits of those of `StageRenderer`, unless `keeps_guides` is set.

    Parameters
    ----------
    ready
        What its passes need.
    viewers
        Returns the cameras for which emission is guided.
    planned
        The number of passes for which samples are chosen.
    like
        The earlier frame; None for the first.
    keeps_guides
        Whether emission is guided as in the earlier frame, whatever has changed. This is for quick first pictures.
    unwanted
        Returns whether the frame is no longer wanted; it then ends with `Cancelled` before the next part of a phase.
    """

    def __init__(
        self, ready: Prepared, viewers: Callable[[], Sequence[scene.Camera]], planned: int | None,
        like: LiveRenderer | None = None, keeps_guides: bool = False, unwanted: Callable[[], bool] = lambda: False,
    ) -> None:  # fmt: skip
        self._like, self._keeps_guides, self._unwanted = like, keeps_guides, unwanted
        self._ready, self._viewers = ready, tuple(viewers())
        self._lights: dict[int, tuple[Simulated, PhotonLighting | None]] = {}
        self._pictures: dict[tuple[int, int], Any] = {}
        super().__init__(ready.shutter, ready.window, ready.settings, ready.holdouts, lambda: self._viewers, planned)
        if like is not None and self._lit_like(like) and planned == like.planned:
            self._lights = dict(like._lights)
            if equal(ready.shutter.at(0.0).cameras, like._ready.shutter.at(0.0).cameras):
                self._pictures = dict(like._pictures)
        self._like = None  # a chain of references would keep all earlier frames

    def first_light(self) -> Simulated | None:
        """Return the light of the first pass; None if it was not traced yet, or if anything moves."""
        return self._with_looks(self._lights[0][0]) if 0 in self._lights else None

    def _with_looks(self, light: Simulated) -> Simulated:
        """Return the light of an earlier frame with the looks of this one."""
        looks = self._shutter.at(0.0).scene.looks()
        return replace(light, sets=[each._replace(look=looks.get(each.name)) for each in light.sets])

    def described_media(self) -> dict[int, scene.Medium]:
        """Return the media by the numbers by which beams refer to them."""
        world = self._worlds[-1]
        both = zip(world.description.media, world.media.all, strict=True)
        return {rendered.number: described for described, rendered in both}

    def projection(self) -> Projection:
        """Return how the whole picture is projected."""
        return View(self._ready.shutter.at(0.0).cameras[0], self._window.whole()).projection

    def _no_statistics(self) -> Statistics:
        return _Cancellable(unwanted=self._unwanted)

    def _known_worlds(self) -> list[StageWorld]:
        return [] if self._like is None else self._like._worlds[-1:]

    def _seen_past_portals(self, world: StageWorld, view: View) -> frozenset[str]:
        if self._keeps_guides and self._like is not None:
            return frozenset(self._like._simulation.light_side)
        return super()._seen_past_portals(world, view)

    def _guided(self, simulation: StageSimulation, world: StageWorld, views: Sequence[Projection]) -> StageSimulation:
        like = self._like
        if like is None:
            return super()._guided(simulation, world, views)
        own, other = self._window, like._window  # guides depend on the size of the whole picture, not on the crop
        same_views = (own.width, own.height) == (other.width, other.height) and equal(self._viewers, like._viewers)
        if self._keeps_guides or (same_views and self._has_light_of(like, world)):
            known = like._simulation
            return replace(simulation, guides=known.guides, openings=known.openings, counts=known.counts)
        return super()._guided(simulation, world, views)

    def _lit_like(self, like: LiveRenderer) -> bool:
        """Return whether each pass has the same light paths as in an earlier frame."""
        if self._ready.shutter.moving or self.settings.program is not None:
            return False
        own, other = self._simulation, like._simulation
        same_guides = own.guides is other.guides and own.light_side == other.light_side
        return same_guides and self._has_light_of(like, self._worlds[-1]) and self._window == like._window

    def _has_light_of(self, like: LiveRenderer, world: StageWorld) -> bool:
        """Return whether an earlier frame has the same lights, media, surfaces and settings; looks may differ."""
        if as_passes(self.settings) != as_passes(like.settings):
            return False
        own, other = world.description, like._worlds[-1].description
        if own is other:
            return True
        rest = [each.name for each in fields(own) if each.name not in ("lights", "drawn")]
        makers = (own.lights, other.lights), (own.drawn, other.drawn)
        return all(equal(getattr(own, name), getattr(other, name)) for name in rest) and all(
            len(mine) == len(theirs) and all(map(_but_for_looks, mine, theirs)) for mine, theirs in makers
        )

    def _lit(self, number: int) -> tuple[Simulated, PhotonLighting | None]:
        if number not in self._lights:
            found = super()._lit(number)
            if number < _KEPT:
                self._lights[number] = found
            return found
        light, photons = self._lights[number]
        light = self._with_looks(light)
        self.statistics.beams += sum(len(each.beams) for each in light.sets)
        return light, photons

    def _seen_in(
        self, numbers: range, view: int, film: Film, light: Simulated, photons: PhotonLighting | None
    ) -> tuple[list[Any], ViewRays]:
        key = numbers.start, view
        if key not in self._pictures:
            found = super()._seen_in(numbers, view, film, light, photons)
            if numbers.stop <= _KEPT:
                self._pictures[key] = found
            return found
        return self._pictures[key]  # type: ignore[no-any-return]


def _but_for_looks(one: Any, other: Any) -> bool:
    """Return whether two lights or sets of drawn beams differ at most in their looks; either both have one or none."""
    if type(one) is not type(other) or (one.look is None) != (other.look is None):
        return False
    return all(equal(getattr(one, each.name), getattr(other, each.name)) for each in fields(one) if each.name != "look")
