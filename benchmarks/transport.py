"""`photon_beams` in Mitsuba scenes: against `volpath` at equal error, volumetric caustics, mirrors, a million beams."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import drjit as dr
import numpy as np
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.estimators import image as images
from photonbeams.render import gathering as gatherings
from photonbeams.render.scene_frame import begin, render
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from tests.helpers.comparison import camera, comparison_scene, lit, single_scattering
from tests.helpers.mitsuba_scenes import comparison, rgb

from . import references, variance
from .rays import grid_tests

mi = mitsuba()
T = mi.ScalarTransform4f

SIZE = (320, 180)
#: Cases of the comparison scene: the longest path, passes and paths of `photon_beams`, samples of `volpath`, and by how
#: many times `photon_beams` should be faster at equal error.
CASES = {
    "single": (2, Settings(passes=2, beams=8192, max_depth=2, method="beams"), 512, 1000),
    "all": (-1, Settings(passes=4, beams=16384, method="beams"), 384, 300),
}
STAGE = {"passes": 4, "beams": 16384}
# With all scattering, `volpath` would need days for a reference: 8,192 samples are still off by 7 %. So `photon_beams`
# renders it with many paths. Its mean must be that on which three other renderers agree: 0.1433 ± 0.0003.
REFERENCE = Settings(passes=16, beams=1 << 16, seed=99, method="beams")
MEAN = 0.1433
PEER_BEAMS, PEER_SECONDS = 113_000, 6.7  # a C++ renderer's photon beams, per sample on two cores, 1280 × 720
#: The glass ball: the scene, a reference with other samples and smaller radii, and the error to reach.
BALL = Path(__file__).parents[1] / "examples" / "mitsuba" / "glass_ball.xml"
BALL_REFERENCE, CAUSTIC_ERROR = Settings(passes=24, beams=1 << 15, seed=99, method="beams"), 0.05
MILLION, MEMORY_TARGET, TRACING_TARGET, RATE_TARGET = 1_000_000, 3.0, 25, 40


def report(console: Console) -> None:
    """Print all tables."""
    references.report(console)
    variance.report(console)
    beside_volpath(console)
    beside_the_peer(console)
    caustic(console)
    mirrors(console)
    million(console)


# -- the comparison scene --------------------------------------------------------------------------------------------


def beside_volpath(console: Console) -> None:
    """Print the seconds of `photon_beams` and of `volpath` at the same error."""
    scene = comparison(*SIZE)
    title = f"Comparison scene, {SIZE[0]} × {SIZE[1]}: median relative error over lit pixels"
    table = Table(title=title, caption="volpath as measured, and its seconds scaled by 1/√spp to the error of ours")
    for name in ("", "", "seconds", "error", "at our error", "ratio", "goal"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    for name, (depth, settings, spp, goal) in CASES.items():
        first, _ = timed(lambda settings=settings: ours(scene, settings))
        spent, picture = timed(lambda settings=settings: ours(scene, settings), rounds=2)
        path_spent, path_picture = timed(lambda depth=depth, spp=spp: volpath(scene, spp, depth), rounds=1)
        if depth == 2:
            reference, about = single_scattering(*SIZE)[..., None], "against the integral"
        else:
            reference = ours(scene, REFERENCE)
            mean = reference.mean()
            about = f"against ours, mean {mean:.4f} ({MEAN})"
        error, path_error = (median_error(each, reference) for each in (picture, path_picture))
        scaled = path_spent * (path_error / error) ** 2
        passes = f"{settings.passes} × {settings.beams:,} (first: {first:.1f} s)"
        table.add_row(name, passes, f"{spent:.3f}", f"{error:.2%}", f"{spent:.3f}", f"{scaled / spent:,.0f} ×",
                      f"≥ {goal:,} ×")  # fmt: skip
        table.add_row("", f"volpath, {spp} samples", f"{path_spent:.2f}", f"{path_error:.2%}", f"{scaled:,.1f}")
        table.add_row("", about)
    # The last case's reference and seconds: all scattering.
    first, _ = timed(as_a_stage)
    spent, picture = timed(as_a_stage, rounds=2)
    error = median_error(picture, reference)
    scaled = path_spent * (path_error / error) ** 2
    table.add_row("all, a stage", f"{STAGE['passes']} × {STAGE['beams']:,} (first: {first:.1f} s)", f"{spent:.3f}",
                  f"{error:.2%}", f"{spent:.3f}", f"{scaled / spent:,.0f} ×", "≥ 300 ×")  # fmt: skip
    table.add_row("", f"mean {picture.mean():.4f} ({MEAN})")
    console.print(table)


def as_a_stage() -> Any:
    """Return the picture of the same scene as a shot of lights, meshes and a medium, (H, W, 3)."""
    shot = pb.Shot(comparison_scene(), camera())
    return shot.render(width=SIZE[0], height=SIZE[1], max_depth=-1, **STAGE).layers["rgba"][..., :3]


def ours(scene: Any, settings: Settings) -> Any:
    """Return the picture, (H, W, 3)."""
    return render(scene, scene.sensors()[0], settings).layers()["rgba"][..., :3]


def volpath(scene: Any, spp: int, depth: int = -1, seed: int = 0) -> Any:
    """Return the picture of Mitsuba's own integrator, (H, W, 3), rendered in parts that fit into memory."""
    integrator = mi.load_dict({"type": "volpath", "max_depth": depth, "rr_depth": 50})
    total, part = 0.0, next(part for part in (64, 4, 1) if spp % part == 0)
    for index in range(spp // part):
        image = mi.render(scene, integrator=integrator, spp=part, seed=seed + index)
        total = total + np.array(image)[..., :3] / (spp // part)
    return total


def median_error(picture: Any, reference: Any) -> float:
    """Return the median relative error over the lit pixels."""
    kept = lit(reference.mean(axis=2))
    return float(np.median(np.abs(picture.mean(axis=2)[kept] / reference.mean(axis=2)[kept] - 1)))


def timed(run: Callable[[], Any], rounds: int = 0) -> tuple[float, Any]:
    """Return the least seconds of some rounds after a warm-up, and the result; 0 rounds measure the first call."""
    spent, result = [], None
    for _ in range(rounds + 1):
        dr.sync_thread()
        start = perf_counter()
        result = run()
        dr.sync_thread()
        spent.append(perf_counter() - start)
    return min(spent), result


# -- the other figures -----------------------------------------------------------------------------------------------


def beside_the_peer(console: Console) -> None:
    """Print the seconds of a pass at 1280 × 720 with as many beams as the C++ renderer had."""
    scene = comparison(1280, 720)
    settings = Settings(passes=1, beams=1 << 14, radius=0.01, alpha=1.0, guiding=False, method="beams")
    found = render(scene, scene.sensors()[0], settings).statistics.beams
    settings = replace(settings, beams=round(settings.beams * PEER_BEAMS / found))
    frame = begin(scene, scene.sensors()[0], settings)
    frame.add_pass(0)
    spent = []
    for number in (1, 2):
        start = perf_counter()
        frame.add_pass(number)
        dr.sync_thread()
        spent.append(perf_counter() - start)
    beams = frame.statistics.beams / frame.statistics.passes
    table = Table(title="Comparison scene, 1280 × 720, radius 0.01, all scattering, neither portal nor guiding")
    for name in ("", "beams", "seconds a pass", "goal"):
        table.add_column(name, justify="right" if name else "left")
    table.add_row("photon_beams", f"{beams:,.0f}", f"{min(spent):.2f}", f"≤ {PEER_SECONDS / 10:.2f}")
    table.add_row("the peer, C++", f"{PEER_BEAMS:,}", f"{PEER_SECONDS}", "")
    console.print(table)


def caustic(console: Console) -> None:
    """Print the seconds to an error of 5 % for the light behind a ball of glass."""
    scene = mi.load_file(str(BALL), width=str(SIZE[0]), height=str(SIZE[1]))
    sensor = scene.sensors()[0]
    base = Settings(surfaces=False, method="beams")
    reference = render(scene, sensor, BALL_REFERENCE).layers()
    seconds, passes, error = 0.0, 1, 1.0
    while error > CAUSTIC_ERROR and passes < 64:
        passes *= 2
        settings = replace(base, passes=passes)
        render(scene, sensor, replace(base, passes=1))  # warms up
        seconds, frame = timed(partial(render, scene, sensor, settings))
        error = median_error(frame.layers()["beams"], reference["beams"])
    one, _ = timed(lambda: volpath(scene, 4), rounds=1)
    spp = max(4, 4 * round(seconds / one))
    path_seconds, picture = timed(lambda: volpath(scene, spp))
    path_error = median_error(picture, reference["rgba"][..., :3])
    table = Table(title=f"Glass ball, {SIZE[0]} × {SIZE[1]}: median error over lit pixels")
    for name in ("", "", "seconds", "error", "goal"):
        table.add_column(name, justify="right" if name else "left")
    table.add_row(
        "photon_beams", f"{passes} passes, beams alone", f"{seconds:.2f}", f"{error:.2%}", f"{CAUSTIC_ERROR:.0%}"
    )
    table.add_row("volpath", f"{spp} samples, whole picture", f"{path_seconds:.2f}", f"{path_error:.1%}", "")
    console.print(table)


def mirrors(console: Console) -> None:
    """Print the tests per second of a picture that is seen in a mirror."""
    scene = mirror_scene()
    settings = Settings(passes=1, beams=4096, surfaces=False, method="beams")
    frame = begin(scene, scene.sensors()[0], settings)
    seconds, tests = [], 0

    def counted(beams: Any, rays: Any, **given: Any) -> Any:
        nonlocal tests
        tests = grid_tests(beams, rays)
        dr.sync_thread()
        start = perf_counter()
        result = plain(beams, rays, **given)
        dr.eval(result)
        dr.sync_thread()
        seconds.append(perf_counter() - start)
        return result

    plain, gatherings.estimate_rays = gatherings.estimate_rays, counted
    try:
        frame.add_pass(0)  # compiles
        frame.add_pass(1)
    finally:
        gatherings.estimate_rays = plain
    table = Table(title=f"Fog in a mirror, {SIZE[0]} × {SIZE[1]}: the grid, lists included (kernels alone: `rays`)")
    for name in ("beams", "M tests", "seconds", "M tests/s", "goal"):
        table.add_column(name, justify="right")
    rate = tests / seconds[-1] / 1e6
    beams = frame.statistics.beams // 2
    table.add_row(f"{beams:,}", f"{tests / 1e6:,.0f}", f"{seconds[-1]:.2f}", f"{rate:.0f}", f"≥ {RATE_TARGET}")
    console.print(table)


def mirror_scene() -> Any:
    """Return a cube of fog with a lamp beside it, all of it seen in a mirror."""
    fog = {"type": "homogeneous", "sigma_t": 0.5, "albedo": 0.9}
    film = {"type": "hdrfilm", "width": SIZE[0], "height": SIZE[1], "rfilter": {"type": "box"}}
    return mi.load_dict({
        "type": "scene",
        "fog": {"type": "cube", "bsdf": {"type": "null"}, "interior": fog},
        "lamp": {"type": "sphere", "center": [-2.0, 0.5, 0.0], "radius": 0.3,
                 "emitter": {"type": "area", "radiance": rgb(30.0)}},
        "mirror": {"type": "rectangle", "to_world": T().translate([0, 0, 3]).rotate([1, 0, 0], 180).scale(9),
                   "bsdf": {"type": "conductor", "material": "none"}},
        "sensor": {"type": "perspective", "fov": 45, "film": film,
                   "to_world": T().look_at([0, 0, 2], [0, 0, 3], [0, 1, 0])},
    })  # fmt: skip


def million(console: Console) -> None:
    """Print memory, and the fraction of time for tracing, of a pass of a million beams in a process of its own."""
    child = subprocess.run(
        [sys.executable, "-m", "benchmarks.transport"], stdout=subprocess.PIPE, check=True, text=True
    )
    found = json.loads(child.stdout)
    table = Table(title=f"A million beams a pass, comparison scene, {SIZE[0]} × {SIZE[1]}")
    for name in ("beams", "seconds a pass", "tracing and lists", "goal", "peak memory", "goal"):
        table.add_column(name, justify="right")
    table.add_row(
        f"{found['beams']:,.0f}", f"{found['seconds']:.2f}", f"{found['share']:.0%}", f"< {TRACING_TARGET} %",
        f"{found['memory']:.2f} GiB", f"≤ {MEMORY_TARGET:g} GiB",
    )  # fmt: skip
    console.print(table)


def measure() -> dict[str, float]:
    """Return beams, seconds, their fraction outside the gathering kernels, and peak memory of such a pass."""
    scene = comparison(*SIZE)
    sample = render(scene, scene.sensors()[0], Settings(passes=1, beams=1 << 14, method="beams")).statistics.beams
    paths = round(MILLION / sample * (1 << 14))
    frame = begin(scene, scene.sensors()[0], Settings(beams=paths, method="beams"))
    frame.add_pass(0)
    gathering, spent = 0.0, 0.0

    def kernel(plain: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **given: Any) -> Any:
            nonlocal gathering
            dr.sync_thread()
            start = perf_counter()
            result = plain(*arguments, **given)
            dr.eval(result)
            dr.sync_thread()
            gathering += perf_counter() - start
            return result

        return run

    plain = images._ImageGather._sum
    images._ImageGather._sum = kernel(plain)  # type: ignore[method-assign]
    try:
        start = perf_counter()
        frame.add_pass(1)
        dr.sync_thread()
        spent = perf_counter() - start
    finally:
        images._ImageGather._sum = plain  # type: ignore[method-assign]
    unit = 1 if sys.platform == "darwin" else 1024
    return {
        "beams": frame.statistics.beams / 2, "seconds": spent, "share": 1 - gathering / spent,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30,
    }  # fmt: skip


if __name__ == "__main__":
    print(json.dumps(measure()))
