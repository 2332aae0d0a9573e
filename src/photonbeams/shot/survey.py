"""What the light of a scene does, from a few rays: for `photonbeams info`, and for layers over exports.

A scene without fog is looked at with a fog that suits the distance of what its camera sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..scene import Camera, Medium, Scene
from ..scene.places import Origin

if TYPE_CHECKING:
    from ..render.pilots.pilot import Pilot
    from ..scene import Array
    from ..transport.guiding.lines import LightLines
    from ..transport.light_tracer import Reach
    from ..world.cameras.cameras import View
    from ..world.emitters.rectangles import Sides
    from ..world.world import World

#: Optical depth of a fog in which shafts show, up to what a camera sees: surfaces there lose 22 % of their light.
DEPTH = 0.25
# From this fraction on, all of a lamp's light is seen: no opening keeps the rest away.
_WHOLE = 0.95
# The reflectance that surfaces are taken to have, and the pixels of a render's usual width.
_GREY, _WIDTH = 0.5, 1280


@dataclass(frozen=True)
class Survey:
    """What the light of a scene does.

    Attributes
    ----------
    scene
        The scene as it is.
    cameras
        The cameras that look at it, by name, the most important first.
    """

    scene: Scene
    cameras: Mapping[str, Camera]

    @cached_property
    def distance(self) -> float:
        """How far away what the first camera sees is, in scene units; the size of the scene if it sees nothing."""
        seen = [lines.surfaces for lines in self._lines.values() if lines.surfaces is not None]
        return float(np.median(seen[0].distance.numpy())) if seen else self._world.extent

    @cached_property
    def scattering(self) -> float:
        """The scattering per scene unit of a fog in which shafts show, to one digit."""
        return float(f"{DEPTH / self.distance:.1g}")

    @cached_property
    def paper(self) -> dict[str, dict[str, Array]]:
        """The radiance of white paper on the surfaces that each camera sees, (N, 3), by the names of lamps."""
        emitters = self._world.emitters
        return {name: {each.name: lines.white(each) for each in emitters} for name, lines in self._lines.items()}

    @cached_property
    def _lines(self) -> dict[str, LightLines]:
        """The lines along which lamps light what each camera sees."""
        from ..transport.guiding.lines import LightLines

        return {name: LightLines(self._world, view.projections) for name, view in self._views.items()}

    @cached_property
    def reach(self) -> dict[str, Reach]:
        """What part of each lamp's light gets into fog and is seen, by the names of lamps that make beams."""
        return self._pilot.reach if self._makes_beams else {}

    @cached_property
    def openings(self) -> dict[str, list[Sides]]:
        """The openings through which lamps light what cameras see; none of lamps with portals, or that are all seen."""
        zero = self._pilot.world.zero
        hidden = [name for name, each in self.reach.items() if max(each.seen, default=0) < _WHOLE]
        found = self._pilot.openings(hidden)
        return {name: [(corner - zero, x, y) for corner, x, y in sides] for name, sides in found.items()}

    @cached_property
    def shafts(self) -> list[str]:
        """The names of the lamps of whose light in fog a camera sees some, or may, as where beams follow guides."""
        guided = {each.name for each in self.scene.lights if getattr(each, "guides", ())}
        return [
            name for name, each in self.reach.items() if any(each.seen) or self.openings.get(name) or name in guided
        ]

    @cached_property
    def doubts(self) -> list[str]:
        """Sentences about gaps that are finer than the beams of a usual render are wide."""
        from ..render.pilots.beam_widths import sentences

        return [*sentences(self._pilot.light())] if self._makes_beams and self.cameras else []

    def exposure(self, name: str) -> float:
        """Return about which exposure in stops suits the picture of a camera; 0 if no lamp lights it."""
        from ..images.display import exposure_of

        light = sum(self.paper[name].values(), np.zeros((1, 3)))
        return exposure_of(_GREY * self.cameras[name].exposure_scale * light)

    def white(self, name: str, lamp: str) -> tuple[float, float]:
        """Return which fraction of what a camera sees a lamp lights, and the median radiance of white paper there."""
        light: Array = self.paper[name][lamp].max(axis=1)
        lit = light[light > 0]
        return len(lit) / max(len(light), 1), float(np.median(lit)) if len(lit) else 0.0

    def lit(self, name: str) -> float:
        """Return which fraction of what a camera sees is lit straight from lamps."""
        light = sum(self.paper[name].values(), np.zeros((1, 3)))
        return float(np.mean(light.max(axis=1) > 0)) if len(light) else 0.0

    @property
    def _makes_beams(self) -> bool:
        return any(each.emits_beams for each in self.scene.lights)

    @cached_property
    def _world(self) -> World:
        return self._built(self.scene)

    @cached_property
    def _pilot(self) -> Pilot:
        """The pilot of a usual render of the scene with fog."""
        from ..render.light import tuning_of
        from ..render.pilots.pilot import Pilot
        from ..render.settings import Settings
        from ..render.worlds import StillWorld
        from ..transport.simulation import Simulation

        settings, content = Settings(), self._in_fog
        world, depth = (
            self._world if content is self.scene else self._built(content),
            settings.depth(2 + content.bounces),
        )
        simulation = Simulation(tuning_of(settings, depth))
        return Pilot(StillWorld(world), settings, depth, simulation, [*self._views.values()])

    @cached_property
    def _in_fog(self) -> Scene:
        """The scene with fog."""
        if self.scene.media:
            return self.scene
        return replace(self.scene, media=(Medium(scattering=self.scattering),))

    def _built(self, content: Scene) -> World:
        from ..world.described import world_of_scene

        eyes = [np.asarray(self._origin.local(each).to_world)[:3, 3] for each in self.cameras.values()]
        return world_of_scene(self._origin.local(content), eyes, sharp=True)

    @cached_property
    def _origin(self) -> Origin:
        """The point from which the scene is measured."""
        from ..world.bounds import origin_of

        return Origin(origin_of([self.scene], [np.asarray(each.to_world)[:3, 3] for each in self.cameras.values()]))

    @cached_property
    def _views(self) -> dict[str, View]:
        """What each camera sees."""
        from ..world.cameras.cameras import View, Window

        result = {}
        for name, camera in self.cameras.items():
            height = max(1, round(_WIDTH * camera.vertical_aperture / camera.horizontal_aperture))
            local = replace(self._origin.local(camera), lens_radius=0.0)
            result[name] = View(local, Window.full(_WIDTH, height))
        return result
