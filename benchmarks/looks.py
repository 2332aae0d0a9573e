"""The cost of looks beside the physical one: kernels of the tiled estimators, run by turns."""

from __future__ import annotations

from time import perf_counter

import drjit as dr
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.estimators.points import Points

from .scenes import Fan, Picture

BEAMS, ROUNDS, LIMIT = 5_000, 5, 1.2
_KNOTS, _COLORS = [0, 0.5, 1], [[1, 1, 1], [1, 0.3, 0], [0, 0, 0.2]]

#: Presets have a target. Programmed looks have none, because their cost depends on the program.
PRESETS = {
    "along: exponential": {"along": pb.looks.Exponential(2.0)},
    "along: power": {"along": pb.looks.Power(2.0, 0.5)},
    "along: polynomial": {"along": pb.looks.Polynomial([1, 0, -0.9])},
    "along: ramp × physical": {"along": pb.looks.ColorRamp(_KNOTS, _COLORS) * pb.looks.Attenuation()},
    "along: texture × physical": {"along": pb.looks.Texture(_COLORS) * pb.looks.Attenuation()},
    "along: fade × physical": {"along": pb.looks.Fade(1, 3) * pb.looks.Attenuation()},
    "along: variation × physical": {"along": pb.looks.Variation(0.5) * pb.looks.Attenuation()},
    "across: constant": {"across": pb.looks.Uniform()},
    "across: biweight": {"across": pb.looks.Biweight()},
    "across: gaussian": {"across": pb.looks.Gaussian()},
    "across: smoothstep": {"across": pb.looks.Smoothstep(0.3)},
    "across: hollow": {"across": pb.looks.Hollow(0.5)},
    "across: tabulated": {"across": pb.looks.Tabulated([0.1, 0.2, 1, 0.6, 0])},
    "eye: none": {"eye": 1.0},
    "eye: exponential": {"eye": pb.looks.Exponential(3.0)},
    "angle: constant": {"angle": pb.looks.Isotropic()},
    "angle: glow": {"angle": pb.looks.Glow()},
}
PROGRAMMED = {
    "expression of s": {"along": "smoothstep(0, 1, s) * [1, 0.8, 0.5]"},
    "expression of s and noise": {"along": "smoothstep(0, 1, s) * (0.6 + 0.4 * noise(4 * P + time))"},
    "colours by radius": {"across": pb.looks.ColorRamp(_KNOTS, _COLORS, space="radius")},
    "noise, 4 octaves": {"across": pb.looks.Epanechnikov() * pb.looks.Noise(scale=0.5)},
}


def report(console: Console) -> None:
    """Print the least seconds of each look's kernels, and their ratio to the physical look's."""
    picture, points, beams = Picture(), Points(pb.gauss_legendre(6)), Fan.of(BEAMS).beams()
    looks = {name: pb.Look(**factors) for name, factors in ({"plain": {}} | PRESETS | PROGRAMMED).items()}
    least = dict.fromkeys(looks, float("inf"))
    again: dict[str, int] = dict.fromkeys(looks, 0)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for turn in range(ROUNDS + 1):  # the first compiles
            for name, look in looks.items():
                dr.sync_thread()
                dr.kernel_history_clear()
                begin = perf_counter()
                picture.of(beams, look, "auto", points)
                dr.sync_thread()
                least[name] = min(least[name], perf_counter() - begin)
                if turn:
                    history = dr.kernel_history()
                    again[name] += sum(each["type"].name == "JIT" and not each["cache_hit"] for each in history)
    table = Table(title=f"Looks: {BEAMS:,} beams, 1280 × 720, auto, least of {ROUNDS} runs by turns")
    for column in ("", "seconds", "ratio", "target", "compiled again"):
        table.add_column(column, justify="right" if column else "left")
    for name in looks:
        target = f"≤ {LIMIT:g}" if name in PRESETS else ""
        table.add_row(name, f"{least[name]:.3f}", f"{least[name] / least['plain']:.2f}", target, str(again[name]))
    console.print(table)
