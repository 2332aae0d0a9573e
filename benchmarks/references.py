"""Mitsuba's Z-test on twelve small scenes: pictures of 64 passes, by `mi.render`, against converged ones of `volpath`.

The references are stored beside this file, with the variance of one sample of `volpath`; `python -m
benchmarks.references` renders them again. A pixel passes if 64 samples of `volpath` may have its error, with Šidák's
correction for the number of pixels. A picture passes if 99.75 % of its pixels do.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.special import ndtr

from photonbeams.runtime.device import mitsuba
from tests.helpers.mitsuba_scenes import camera, cloud, cube_of, fog, load, rgb

mi = mitsuba()
T = mi.ScalarTransform4f
FILE = Path(__file__).with_suffix(".npz")
SIZE, PASSES, DEPTH = 24, 64, 16
SAMPLES, BATCHES = 128, 128  # of the references
SIGNIFICANCE, PIXELS, MEAN, SCENES = 0.01, 0.9975, 0.005, 11


def _scene(**parts: Any) -> Any:
    return load(**{"sensor": camera(size=SIZE), **parts})


def _ball(medium: Any, surface: str = "null", radius: float = 1.0, **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "radius": radius, "bsdf": {"type": surface, **more}, "interior": medium}


def _lamp(place: tuple[float, float, float], size: float, radiance: float) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": T().look_at(place, [0, 0, 0], [0, 0, 1]).scale(size),
            "emitter": {"type": "area", "radiance": rgb(radiance)}}  # fmt: skip


def _floor(height: float = -1.1) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": T().translate([0, height, 0]).rotate([1, 0, 0], -90).scale(3)}


def _sky() -> dict[str, Any]:
    """Return a sky with a bright side and a dark one."""
    x, y = np.meshgrid(np.linspace(-np.pi, np.pi, 32), np.linspace(0, np.pi, 16))
    pixels = 0.6 + 0.4 * np.cos(x)[..., None] * np.sin(y)[..., None] * np.array([1.0, 0.5, -0.5])
    bitmap = mi.Bitmap(pixels.astype(np.float32))
    return {"type": "envmap", "bitmap": bitmap, "scale": 1.0}


def _spot() -> dict[str, Any]:
    return {"type": "spot", "to_world": T().look_at([1.5, 3, 1], [0, 0, 0], [0, 1, 0]), "intensity": rgb(20.0),
            "cutoff_angle": 35}  # fmt: skip


def _grid_of_albedo() -> dict[str, Any]:
    return cloud(albedo={"type": "gridvolume", "grid": _numbers(), "to_world": T().translate(-1).scale(2)})


def _numbers() -> Any:
    return mi.VolumeGrid(np.random.default_rng(1).uniform(0.2, 0.95, (4, 4, 4, 3)).astype(np.float32))


def _room() -> dict[str, Any]:
    """Return Mitsuba's Cornell box, without integrator and sensor."""
    return {name: each for name, each in mi.cornell_box().items() if name not in ("type", "integrator", "sensor")}


CASES: dict[str, Callable[[], Any]] = {
    "grid of albedo under a sky": lambda: _scene(fog=cube_of(_grid_of_albedo()), sky=_sky()),
    "cloud on a floor under a spot": lambda: _scene(fog=cube_of(cloud()), spot=_spot(), floor=_floor()),
    "coloured grid that absorbs": lambda: _scene(fog=cube_of(cloud((0.2, 0.6, 1.0)) | {"albedo": 0.0}), sky=_sky()),
    "coloured grid under a lamp": lambda: _scene(
        fog=cube_of(cloud((1.0, 0.6, 0.3))), lamp=_lamp((1.5, 2.5, 1), 0.6, 12.0), floor=_floor()
    ),
    "cube of fog under a lamp": lambda: _scene(
        fog=cube_of(fog(1.0)), lamp=_lamp((0, 2.5, 1), 0.8, 8.0), floor=_floor()
    ),
    "fog in glass under a sky": lambda: _scene(ball=_ball(fog(1.0), "dielectric", int_ior=1.3), sky=_sky()),
    "lamp within its fog": lambda: _scene(
        fog=cube_of(medium := mi.load_dict(fog(0.8))),
        lamp={"type": "sphere", "radius": 0.25, "emitter": {"type": "area", "radiance": rgb(6.0)}, "exterior": medium},
        floor=_floor(),
    ),
    "ball of fog under a sky": lambda: _scene(ball=_ball(fog(2.0, 0.95)), sky=_sky()),
    "things within the fog": lambda: _scene(
        fog=cube_of(medium := mi.load_dict(fog(0.6))),
        sky=_sky(),
        thing={
            "type": "cube",
            "to_world": T().rotate([1, 1, 0], 40).scale(0.4),
            "exterior": medium,
            "bsdf": {"type": "diffuse", "reflectance": rgb([0.7, 0.3, 0.2])},
        },
    ),
    "fog in rough glass under a lamp": lambda: _scene(
        ball=_ball(fog(1.0), "roughdielectric", alpha=0.3, int_ior=1.3),
        lamp=_lamp((1.5, 2.5, 1), 0.6, 12.0),
        floor=_floor(),
    ),
    "coloured fog that scatters forward": lambda: _scene(
        fog=cube_of(fog([0.4, 0.8, 1.6], 0.9, phase={"type": "hg", "g": 0.5})), lamp=_lamp((0, 2.5, 1), 0.8, 8.0)
    ),
    "room without fog": lambda: _scene(**_room(), sensor=camera((0, 0, 3.9), size=SIZE)),
}


class Reference(NamedTuple):
    """The converged picture of `volpath`, (H, W, 3), and the variance of one of its samples."""

    mean: Any
    variance: Any


def passing(picture: Any, samples: int, reference: Reference) -> float:
    """Return the fraction of pixels and channels of a picture, (H, W, 3), that pass Mitsuba's Z-test."""
    variance = np.maximum(reference.variance, 1e-4)
    score = np.abs(picture - reference.mean) * np.sqrt(samples / variance)
    chance = 2 * (1 - ndtr(score))
    pixels = picture.shape[0] * picture.shape[1]
    return float((chance > 1 - (1 - SIGNIFICANCE) ** (1 / pixels)).mean())


def references() -> dict[str, Reference]:
    """Return the stored references."""
    with np.load(FILE) as kept:
        return {name: Reference(kept[f"{name}/mean"], kept[f"{name}/variance"]) for name in CASES}


def report(console: Console) -> None:
    """Print, for each scene, how many pixels pass with `photon_beams` and with `volpath` itself, and the means."""
    table = Table(title=f"Z-test at {PASSES} passes, of pixels", caption=f"a picture passes from {PIXELS:.2%} on")
    for name in ("", "photon_beams", "volpath", "mean, in the reference's"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    kept, passed = references(), 0
    for name, make in track(CASES.items(), "References", console=console, transient=True):
        scene, parts, means = make(), [], []
        for kind in ("photon_beams", "volpath"):
            integrator = mi.load_dict({"type": kind, "max_depth": DEPTH})
            each = [_rendered(scene, integrator, PASSES, seed) for seed in (1, 2)]
            parts.append(float(np.mean([passing(one, PASSES, kept[name]) for one in each])))
            means.append(float(np.mean(each) / kept[name].mean.mean()))
        passed += parts[0] >= PIXELS and abs(means[0] - 1) <= MEAN
        table.add_row(name, f"{parts[0]:.2%}", f"{parts[1]:.2%}", f"{means[0]:.4f} (volpath {means[1]:.4f})")
    table.add_row("scenes that pass, means within 0.5 %", f"{passed}", "", f"goal: {SCENES} of {len(CASES)}")
    console.print(table)


def _rendered(scene: Any, integrator: Any, samples: int, seed: int) -> Any:
    return np.array(mi.render(scene, integrator=integrator, spp=samples, seed=seed))[..., :3].astype(np.float64)


def main() -> None:
    """Render the references again."""
    kept = {}
    for name, make in track(CASES.items(), "References"):
        scene, integrator = make(), mi.load_dict({"type": "volpath", "max_depth": DEPTH})
        found = np.array([_rendered(scene, integrator, SAMPLES, seed) for seed in range(BATCHES)])
        kept[f"{name}/mean"] = found.mean(axis=0).astype(np.float32)
        kept[f"{name}/variance"] = (SAMPLES * found.var(axis=0, ddof=1)).astype(np.float32)
    np.savez_compressed(FILE, **kept)


if __name__ == "__main__":
    main()
