"""The comparison scene by `photon_beams` and by Blender's Cycles with its denoiser: seconds at equal error.

Cycles comes as the module `bpy`, which brings its own libraries: it runs in a separate process, with the Python of
another virtual environment, and nothing else needs it. The reference is known at pixels that are spread over the
picture, and errors are medians over the lit ones. For single scattering the reference is the deterministic integral of
`tests.helpers.comparison`, for all scattering the radiance of many beams along the pixels' rays.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import drjit as dr
import numpy as np
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.render.scene_rays import radiance
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from tests.helpers.comparison import EYE, camera, camera_rays, comparison_scene, lit, scattered_along
from tests.helpers.mitsuba_scenes import comparison, volpath

mi = mitsuba()

#: The Python that has Blender as a module; the set-up makes it.
BPY_PYTHON = Path(sys.prefix) / "bpy" / "bin" / "python"
WORKER = Path(__file__).with_name("cycles_worker.py")
#: For each kind of scattering: the edges of our longest path, and Cycles' bounces in the medium.
DEPTHS = {"single": (2, 0), "all": (-1, 1024)}
#: Passes, and light paths per pass, from the cheapest up.
LADDER = (*((1, 1 << k) for k in range(10, 15)), *((1 << k, 1 << 14) for k in range(1, 6)))
#: What renders our pictures: `mi.render`, the same with `denoise`, and a `Shot` whose light has the hole as its portal.
DOORS = (_, DENOISED, PORTAL) = ("mi.render", "denoised", "portal")
ROUNDS = 3  # medians are over these, after one round that compiles kernels
GOAL, AIM = 10, 20  # times as fast as Cycles
PROBES = 6000  # pixels with a reference, approximately
REFERENCE = Settings(passes=32, beams=1 << 16, method="beams", gather_error=0.0)
CHECKED, CHECK_PASSES = (64, 36), 64  # size and passes, of 64 samples each, for the mean of `volpath`


@dataclass(frozen=True)
class Measured:
    """Seconds of a picture, the mean number of processors, the median error, and the mean over the reference's."""

    name: str
    seconds: float
    processors: float
    error: float
    mean: float

    def cells(self) -> list[str]:
        """Return the cells of a table's row."""
        return [self.name, f"{self.seconds:.2f} s", f"{self.processors:.1f}", f"{self.error:.2%}", f"{self.mean:.3f}"]


COLUMNS = ("picture", "seconds", "processors", "error", "mean")


class Reference:
    """The true radiance at pixels that are spread over a picture."""

    def __init__(self, kind: str, size: tuple[int, int]) -> None:
        width, height = size
        step = max(1, round((width * height / PROBES) ** 0.5))
        self._pixels = np.s_[step // 2 :: step, step // 2 :: step]
        origin, direction = (each.reshape(height, width, 3)[self._pixels] for each in camera_rays(width, height))
        rays = origin.reshape(-1, 3), direction.reshape(-1, 3)
        if kind == "single":
            found = scattered_along(*rays)
            self.about = "the deterministic integral"
        else:
            halves = [_along(rays, seed) for seed in (1, 2)]
            found = (halves[0] + halves[1]) / 2
            noise = np.median(np.abs(halves[0] - halves[1])[lit(found)] / found[lit(found)]) / 2
            self.about = f"2 × {REFERENCE.passes} × {REFERENCE.beams:,} paths of ours, noise {noise:.2%}"
        self.radiance = found.reshape(origin.shape[:2])

    def compared(self, picture: Any) -> tuple[float, float]:
        """Return the median relative error over lit pixels of a picture, (H, W), and its mean over the reference's."""
        kept = lit(self.radiance)
        found, true = picture[self._pixels][kept], self.radiance[kept]
        return float(np.median(np.abs(found / true - 1))), float(found.mean() / true.mean())


def _along(rays: tuple[Any, Any], seed: int) -> Any:
    """Return the radiance along rays, (N,), by many beams."""
    passes = REFERENCE.passes  # each pass evaluates every ray
    given = (mi.Point3f(*np.float32(each.repeat(passes, axis=0).T)) for each in rays)
    found = radiance(comparison(), mi.Ray3f(*given), mi.Bool(True), Settings.of(REFERENCE, {"seed": seed}), set())
    return (found.beams + found.surface).numpy().mean(axis=0).reshape(-1, passes).mean(axis=1)


def job(bounces: int) -> dict[str, Any]:
    """Return the job of `cycles_worker`: the comparison scene in plain numbers, with the medium in the first mesh.

    The light's power is its flux in watts, π · radiance · area, which is what Blender calls an area light's power.
    """
    scene: Any = comparison_scene()
    (light,), (fog,), view = scene.lights, scene.media, camera()
    side = 2 * float(np.linalg.norm(light.half_y))
    matrix = np.eye(4)  # looks along −z, with +y up
    matrix[:3, 3] = EYE
    angle = 2 * np.arctan(view.horizontal_aperture / (2 * view.focal_length))
    meshes = [{"points": mesh.points.tolist(), "faces": mesh.faces.tolist()} for mesh in scene.meshes]
    medium = {"scattering": fog.scattering, "absorption": fog.absorption, "anisotropy": fog.anisotropy}
    return {
        "surfaces": [{"kind": "diffuse", "color": (0, 0, 0), **mesh} for mesh in meshes],
        "fogs": [{"fog": medium, **meshes[0]}],
        "light": {"center": light.center.tolist(), "axis": light.axis.tolist(), "side": side,
                  "power": np.pi * light.radiance[0] * side**2},
        "background": (0, 0, 0), "bounces": bounces,
        "camera": {"matrix": matrix.tolist(), "angle": angle},
    }  # fmt: skip


def cycles(
    python: Path, job: dict[str, Any], samples: Sequence[int], size: Sequence[int], limit: float
) -> Iterator[tuple[int, Any, float, float]]:
    """Yield Cycles' pictures: the samples, the pixels (H, W, 3), the seconds and the mean number of processors.

    A picture that takes more than `limit` seconds is the last one. The process is stopped after a minute and three
    times `limit` for each picture.
    """
    with tempfile.TemporaryDirectory() as folder:
        given, files = Path(folder) / "job.json", [f"{folder}/{each}.exr" for each in samples]
        given.write_text(
            json.dumps({**job, "size": list(size), "samples": list(samples), "files": files, "limit": limit})
        )
        # Isolated (-I): a module in this folder has the name of Blender's add-on, cycles.
        command = [python, "-I", WORKER, given]
        with (Path(folder) / "log").open("w+") as log:
            child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
            stopped = threading.Timer(60 + len(files) * 3 * limit, child.kill)
            stopped.start()
            try:
                for line in child.stdout or ():
                    if line.startswith("{"):
                        spent = json.loads(line)
                        picture = np.array(mi.Bitmap(f"{folder}/{spent['samples']}.exr"))[..., :3]
                        yield spent["samples"], picture, spent["seconds"], spent["processor"] / spent["seconds"]
                child.wait()
            finally:  # also when the caller stops early: the process would slow down the next measurement
                stopped.cancel()
                child.kill()
                child.wait()
            if child.returncode > 0:
                raise SystemExit(f"Cycles could not render:\n{(Path(folder) / 'log').read_text()}")


def ours(
    door: str, kind: str, size: Sequence[int], passes: int, paths: int, method: str
) -> Iterator[tuple[Any, float, float]]:
    """Yield pictures, (H, W), their seconds and processors. Nothing is kept between them, so pilots count."""
    scene, depth = comparison(*size), DEPTHS[kind][0]
    given = {"type": "photon_beams", "max_depth": depth, "paths": paths, "method": method, "denoise": door == DENOISED}
    whole = {"width": size[0], "height": size[1], "passes": passes, "beams": paths, "max_depth": depth}
    for seed in range(ROUNDS + 1):
        dr.sync_thread()
        begin, cpu = perf_counter(), sum(os.times()[:2])
        if door == PORTAL:
            picture = pb.Shot(comparison_scene(), camera()).render(**whole, seed=seed).layers["rgba"]
        else:
            picture = np.array(mi.render(scene, integrator=mi.load_dict(given), spp=passes, seed=seed))
        seconds = perf_counter() - begin
        if seed > 0:
            yield picture[..., :3].mean(axis=2), seconds, (sum(os.times()[:2]) - cpu) / seconds


def _theirs(given: argparse.Namespace, kind: str, reference: Reference) -> Iterator[Measured]:
    """Yield the measurements of Cycles."""
    pictures = cycles(given.python, job(DEPTHS[kind][1]), given.samples, given.res, given.limit)
    for samples, picture, seconds, processors in pictures:
        yield Measured(f"Cycles, {samples} samples", seconds, processors, *reference.compared(picture.mean(axis=2)))


def _ladder(given: argparse.Namespace, door: str, kind: str, reference: Reference, target: float) -> Iterator[Measured]:
    """Yield our measurements with more and more paths, until the error is at most `target` or time is up."""
    begin = perf_counter()
    for passes, paths in LADDER:
        pictures = ours(door, kind, given.res, passes, paths, given.method)
        rounds = [(*spent, *reference.compared(picture)) for picture, *spent in pictures]
        yield (one := Measured(f"{door}, {passes} × {paths:,}", *np.median(rounds, axis=0).tolist()))
        if one.error <= target or perf_counter() - begin > given.limit:
            return


def report(console: Console, options: Sequence[str] = ()) -> None:
    """Print Cycles' seconds and errors, and how many times as fast we reach errors as low."""
    given = _options(options)
    for kind in given.scattering:

        def told(each: Measured, kind: str = kind) -> Measured:
            console.print(f"[dim]{kind}: {', '.join(each.cells())}[/]")
            return each

        console.print(f"[dim]{kind}: the reference. Then: {', '.join(COLUMNS)}[/]")
        reference = Reference(kind, given.res)
        theirs = [told(each) for each in _theirs(given, kind, reference)]
        target = min((each.error for each in theirs), default=0.0)
        found = [[told(each) for each in _ladder(given, door, kind, reference, target)] for door in given.doors]
        about = f"Errors and means are against {reference.about}. {_check(kind)} Load {os.getloadavg()[0]:.1f}."
        console.print(_table(f"{kind} scattering, {given.res[0]} × {given.res[1]}", about, theirs, found))


def _table(title: str, caption: str, theirs: list[Measured], found: list[list[Measured]]) -> Table:
    """Return the table: Cycles' pictures, and under each, for each door, our fastest picture with an error as low."""
    table = Table(title=f"Cycles with its denoiser: {title}", caption=caption)
    for name in (*COLUMNS, "ratio", "goal"):
        table.add_column(name, justify="right" if name != "picture" else "left", no_wrap=True)
    for each in theirs:
        table.add_row(*each.cells())
        for door in found:
            if reached := [one for one in door if one.error <= each.error]:
                best = min(reached, key=lambda one: one.seconds)
                table.add_row(*best.cells(), f"{each.seconds / best.seconds:.1f} ×", f"≥ {GOAL} ×, aim {AIM} ×")
        table.add_section()
    return table


def _check(kind: str) -> str:
    """Return a sentence with the means of a small picture by `volpath` and by `photon_beams`."""
    scene, depth = comparison(*CHECKED), DEPTHS[kind][0]
    parameters = {"type": "photon_beams", "max_depth": depth, "paths": REFERENCE.beams, "method": "beams"}
    own = np.mean(mi.render(scene, integrator=mi.load_dict(parameters), spp=4))
    theirs = np.mean([volpath(scene, 64, seed, max_depth=depth).mean() for seed in range(CHECK_PASSES)])
    return f"Mean at {CHECKED[0]} × {CHECKED[1]}: volpath {theirs:.4f}, ours {own:.4f}."


def _options(words: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks cycles", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--python", type=Path, default=BPY_PYTHON, help="the one that has bpy")
    parser.add_argument(
        "--samples", default=[4, 16, 64], metavar="N,N…", type=lambda text: [int(each) for each in text.split(",")]
    )
    parser.add_argument("--res", nargs=2, type=int, default=[1280, 720], metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--scattering", nargs="+", choices=DEPTHS, default=list(DEPTHS))
    parser.add_argument("--doors", nargs="+", choices=DOORS, default=list(DOORS), help="what renders ours")
    parser.add_argument("--method", choices=("auto", "beams"), default="auto", help="parameter of photon_beams")
    parser.add_argument("--limit", type=float, default=900, help="seconds of a picture of Cycles, and of each door")
    given = parser.parse_args(words)
    if not given.python.exists():
        parser.error(f"{given.python} is missing: expected a Python that has bpy, by --python (the set-up makes one)")
    return given
