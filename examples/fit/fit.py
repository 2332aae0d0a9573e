"""Fit a look to a painted picture: find the colours along the beams that make the shafts look like the painting.

    .venv/bin/python examples/fit/fit.py examples/shaft/physical.usda examples/fit/painted.png -o out/fit

The picture shows only the beams, on black, seen by the stage's camera. Estimates are differentiable by a look's
texture, so Adam finds the colours in a few dozen steps. The result is a layer with the look, for use over the stage:

    photonbeams render examples/shaft/physical.usda --session-layer out/fit.usda -o out/fitted.png

and out/fit.png, which shows the beams before, the painting, and the beams after.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

import photonbeams as pb

WIDTH, BEAMS, COLORS, STEPS, RATE = 240, 512, 10, 100, 0.12
DARK = 0.1  # light below this counts less, because painters do not control the darkest shades


def main() -> None:
    """Fit, and write a layer and a picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stage", type=Path, help="the shot")
    parser.add_argument("painting", type=Path, help="a picture of its beams as you want them")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/fit"), help="name of the output files, without suffix"
    )
    parser.add_argument("--steps", type=int, default=STEPS, help="number of steps of the optimiser")
    given = parser.parse_args()
    shot = pb.Shot.open(given.stage)
    target = painted(given.painting)
    fit = Fit(shot, target.shape[1], target.shape[0])
    before = fit.picture(None)
    colors = fit.colors(target, given.steps)
    given.output.parent.mkdir(parents=True, exist_ok=True)
    write_layer(given.output.with_suffix(".usda"), shot, fit.names, colors)
    write_strip(given.output.with_suffix(".png"), before, target, fit.picture(colors))


def painted(path: Path) -> np.ndarray:
    """Return a picture's linear colours, (H, W, 3), WIDTH pixels wide."""
    from photonbeams.images.display import srgb_decoded
    from photonbeams.images.files import read_image

    pixels = srgb_decoded(read_image(path)[..., :3])
    step = max(1, pixels.shape[1] // WIDTH)
    height, width = (each // step * step for each in pixels.shape[:2])
    blocks: np.ndarray = pixels[:height, :width].reshape(height // step, step, width // step, step, 3).mean(axis=(1, 3))
    return blocks


class Fit:
    """The beams of a shot toward the pixels of its camera."""

    def __init__(self, shot: pb.Shot, width: int, height: int, beams: int = BEAMS) -> None:
        from photonbeams.runtime.device import Float
        from photonbeams.world.cameras.cameras import View, Window

        scene, camera = shot.read()
        self._medium, self._shape = scene.medium, (height, width)
        # Rays end at the shot's surfaces, whose depth one cheap render finds.
        depth = shot.render(passes=1, width=width, height=height, beams=1).layers["depth"]
        rays = View(camera, Window.full(width, height)).rays((0.5, 0.5))
        self._rays = rays.origin, rays.direction, Float(depth.ravel()) / rays.facing
        self._sets = shot.beams(beams=beams)
        self.names = [each.name for each in self._sets]

    def radiance(self, texture: Any) -> Any:
        """Return the radiance of all beams, (pixels, 3), with these colours along them; None is the physical look."""
        look = pb.Look(
            along=pb.looks.Attenuation() if texture is None else pb.looks.Texture(texture) * pb.looks.Attenuation()
        )
        return sum(pb.estimate(each.beams, *self._rays, look=look, medium=self._medium) for each in self._sets)

    def picture(self, colors: np.ndarray | None) -> np.ndarray:
        """Return the radiance as a picture, (H, W, 3)."""
        found: np.ndarray = self.radiance(colors).numpy()
        return found.reshape(*self._shape, 3)

    def colors(self, target: np.ndarray, steps: int = STEPS) -> np.ndarray:
        """Return the colours along the beams, (COLORS, 3), that come closest to a picture."""
        import drjit as dr
        import mitsuba as mi

        wanted = mi.TensorXf(target.reshape(-1, 3).astype(np.float32))
        optimizer = mi.ad.Adam(lr=RATE)
        optimizer["logarithm"] = dr.zeros(mi.TensorXf, (COLORS, 3))  # of the colours, since light is never negative
        for step in range(steps):
            texture = dr.exp(optimizer["logarithm"])
            off = (self.radiance(texture) - wanted) / (wanted + DARK)
            loss = dr.mean(dr.square(off), axis=None)
            dr.backward(loss)
            optimizer.step()
            if step % 10 == 0 or step == steps - 1:
                print(f"step {step}: loss {loss.numpy().item():.4f}", file=sys.stderr)
        return np.array(dr.exp(optimizer["logarithm"]))


def write_layer(path: Path, shot: pb.Shot, lights: list[str], colors: np.ndarray) -> None:
    """Write a layer with the look, and let the lights use it."""
    from pxr import Sdf, Usd

    path.unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    look = stage.DefinePrim("/Fitted", "PhotonBeamsLook")
    knots = np.linspace(0, 1, len(colors)).tolist()
    look.CreateAttribute("photonbeams:along:ramp:knots", Sdf.ValueTypeNames.FloatArray).Set(knots)
    look.CreateAttribute("photonbeams:along:ramp:colors", Sdf.ValueTypeNames.Color3fArray).Set(
        [tuple(map(float, color)) for color in colors]
    )
    for name in lights:
        stage.OverridePrim(name).CreateRelationship("photonbeams:look").SetTargets([look.GetPath()])
    stage.GetRootLayer().Save()


def write_strip(path: Path, *pictures: np.ndarray) -> None:
    """Write pictures side by side."""
    from photonbeams.images.writing import write_png

    gap = np.ones((pictures[0].shape[0], 4, 3), dtype=np.float32)
    row = [part for picture in pictures for part in (picture.astype(np.float32), gap)][:-1]
    write_png(path, np.concatenate(row, axis=1))


if __name__ == "__main__":
    main()
