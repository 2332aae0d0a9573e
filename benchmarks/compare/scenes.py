"""The thirty scenes of the comparison, and their pictures by the public doors alone.

The code of another commit renders them, too. So only what is stable is called: `pb.Shot`, its `render` and its frame's
layers for stages and files; `mi.render` with the plug-in `photon_beams` for dictionaries.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import mitsuba as mi
import numpy as np
import numpy.typing as npt

import photonbeams as pb

from .made_scenes import ball_under_a_sky, bare_box, caustic
from .random_rooms import room

EXAMPLES = Path(__file__).parents[2] / "examples"
# Beside stages: a fog for the stage that has none, in scattered light per metre.
HAZE = (0.05, 0.05, 0.05)
# Pixels of the pictures of rooms made by chance, their light paths, and how many rooms there are.
ROOM = (96, 72)
ROOM_PATHS = 1024
ROOMS = 12
# Light paths where the usual 16,384 take a third of a minute of processor time behind glass.
FEW = {"beams": 4096}

Layers = dict[str, npt.NDArray[np.float32]]
Renderer = Callable[[int], Layers]


class Scene(Protocol):
    """A scene that is opened anew for each render, so that none takes over what another has learned."""

    def open(self) -> Renderer:
        """Return a function that renders the layers with a seed."""
        ...


@dataclass(frozen=True)
class File:
    """A stage, with a `layer` over it, or a Mitsuba .xml, rendered by `pb.Shot`; paths are relative to examples/."""

    path: str
    size: tuple[int, int]  # pixels, across and down
    passes: int = 1
    frame: int | None = None
    camera: str | None = None
    layer: str | None = None
    fog: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)

    def open(self) -> Renderer:
        """Return a function that renders the layers with a seed."""
        medium = {"medium": pb.Medium(scattering=HAZE)} if self.fog else {}
        layers = () if self.layer is None else (EXAMPLES / self.layer,)
        shot = pb.Shot.open(EXAMPLES / self.path, self.camera, session_layers=layers, **medium)
        width, height = self.size

        def render(seed: int) -> Layers:
            frame = shot.render(self.frame, self.passes, width=width, height=height, seed=seed, **self.settings)
            return dict(frame.layers)

        return render


@dataclass(frozen=True)
class Made:
    """A scene from a dictionary, `make(width, height)`, rendered by `mi.render`."""

    make: Callable[[int, int], dict[str, Any]]
    size: tuple[int, int]  # pixels, across and down
    passes: int = 1
    settings: Mapping[str, Any] = field(default_factory=dict)

    def open(self) -> Renderer:
        """Return a function that renders the picture with a seed."""
        # Mitsuba merges meshes in an order that differs from load to load, and so the order of their lamps does.
        scene = mi.load_dict(self.make(*self.size), optimize=False)
        integrator = mi.load_dict({"type": "photon_beams", **self.settings})

        def render(seed: int) -> Layers:
            picture = mi.render(scene, integrator=integrator, spp=self.passes, seed=seed)
            return {"rgba": np.array(picture)}

        return render


def _rooms() -> dict[str, Scene]:
    """Return the rooms made by chance."""

    def of(number: int) -> Callable[[int, int], dict[str, Any]]:
        return partial(room, number)

    paths = {"paths": ROOM_PATHS}
    return {f"room {number}": Made(of(number), ROOM, settings=paths) for number in range(1, ROOMS + 1)}


SCENES: dict[str, Scene] = {
    "keyhole": File("keyhole/keyhole.usda", (320, 180)),
    "flight": File("keyhole/keyhole.usda", (256, 144), frame=51, camera="Flight"),
    "concert": File("concert/concert.usda", (320, 180)),
    "forest": File("forest/forest.usda", (320, 180)),
    "smoke": File("smoke/smoke.usda", (256, 144)),
    "attic": File("blender/attic.usda", (256, 144), fog=True),
    "shaft": File("shaft/physical.usda", (256, 144)),
    "directed": File("shaft/physical.usda", (256, 144), layer="shaft/directed.usda"),
    "magic": File("magic/magic.usda", (256, 144), frame=1),
    "cloud": File("mitsuba/cloud.xml", (192, 108)),
    "cornell_fog": File("mitsuba/cornell_fog.xml", (128, 128)),
    "flask": File("mitsuba/flask.xml", (160, 90), settings=FEW),
    "glass_ball": File("mitsuba/glass_ball.xml", (160, 90), settings=FEW),
    "mirrors": File("mitsuba/mirrors.xml", (192, 108)),
    "slits": File("mitsuba/slits.xml", (192, 108)),
    "caustic": Made(caustic, (128, 128), settings={"max_depth": 5}),
    "sky": Made(ball_under_a_sky, (128, 96)),
    "bare": Made(bare_box, (128, 128)),
    **_rooms(),
}
