"""The scene of several benchmarks: a fan of thin beams from a small source on the left to a wall on the right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
import numpy.typing as npt

import photonbeams as pb
from photonbeams import scene
from photonbeams.estimators.estimate import ENDLESS
from photonbeams.estimators.image import ImageRadiance, estimate_image
from photonbeams.estimators.lanes import PixelRays
from photonbeams.estimators.points import Points
from photonbeams.runtime.device import Float
from photonbeams.world.cameras.cameras import View, Window

WIDTH, HEIGHT = 1280, 720
RADIUS = 0.003  # a beam is two to three pixels wide
MEDIUM = pb.Medium(scattering=(0.1, 0.12, 0.15), absorption=(0.0, 0.0, 0.0), anisotropy=0.0)
RAMP = pb.Look(along=pb.looks.ColorRamp([0, 0.5, 1], [[1, 1, 1], [1, 0.3, 0], [0, 0, 0.2]]) * pb.looks.Attenuation())


@dataclass(frozen=True)
class Fan:
    """Beams by their ends, (N, 3), in the space of a camera at the origin: x right, y up, looking along −z."""

    start: npt.NDArray[np.float64]
    end: npt.NDArray[np.float64]

    @classmethod
    def of(cls, count: int) -> Fan:
        """Return a fan of `count` beams."""
        rng = np.random.default_rng(0)
        start = np.array([-2, -0.5, -3]) + rng.uniform(-0.05, 0.05, (count, 3))
        end = np.stack([np.full(count, 1.5), rng.uniform(-0.5, 1, count), rng.uniform(-3.5, -2.5, count)], axis=1)
        return cls(start, end)

    def beams(self, radius: float = RADIUS) -> pb.Beams:
        """Return the beams, whose powers add up to 1."""
        return pb.Beams(self.start, self.end, radius, radius, [[1 / len(self.start)] * 3])


class Picture:
    """A picture of 1280 × 720 pixels through a pinhole at `eye`, 64° wide."""

    def __init__(self, eye: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        to_world = np.eye(4)
        to_world[:3, 3] = eye
        camera = scene.Camera(
            "bench", to_world=to_world, focal_length=0.8, horizontal_aperture=1.0, vertical_aperture=9 / 16
        )
        view = View(camera, Window.full(WIDTH, HEIGHT))
        self.projection = view.projection
        count = WIDTH * HEIGHT
        self.rays = PixelRays(*view.rays((0.5, 0.5))[:3], dr.full(Float, ENDLESS, count), dr.zeros(Float, count))
        dr.eval(self.rays.t_max, self.rays.t_min)

    def of(self, beams: pb.Beams, look: pb.Look, estimator: str, points: Points) -> ImageRadiance:
        """Return the beams' picture."""
        return estimate_image(
            beams, self.projection, self.rays, look=look, medium=MEDIUM, estimator=estimator, points=points
        )


def rgb(radiance: Any) -> npt.NDArray[np.float32]:
    """Return the pixels, (N, 3)."""
    return np.ascontiguousarray(radiance.numpy().T)
