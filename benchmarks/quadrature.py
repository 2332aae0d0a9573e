"""The cost of the frustum with Gauss and with Riemann points at equal error, for a picture from inside the beams."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import drjit as dr
import numpy as np
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.estimators.points import Points
from photonbeams.quadrature import Rule

from .scenes import RAMP, Fan, Picture, rgb

BEAMS, BEAM_RADIUS, ROUNDS = 200, 0.15, 3
EYE = (-1.2, -0.3, -2.9)  # inside the fan, across it
ERRORS = (0.01, 0.001, 0.0001)  # RMSE of the picture divided by its mean, against 64 Gauss points
COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128)


def report(console: Console) -> None:
    """Print the points and the seconds that each rule needs for an error."""
    picture, beams = Picture(EYE), Fan.of(BEAMS).beams(BEAM_RADIUS)

    def run(rule: Rule) -> tuple[np.ndarray, float]:
        points, best = Points(rule), float("inf")
        for _ in range(ROUNDS):
            dr.sync_thread()
            begin = perf_counter()
            radiance = picture.of(beams, RAMP, "frustum", points).radiance
            dr.sync_thread()
            best = min(best, perf_counter() - begin)
        return rgb(radiance), best

    exact = rgb(picture.of(beams, RAMP, "frustum", Points(pb.gauss_legendre(64))).radiance)
    table = Table(title=f"Quadrature: frustum of {BEAMS} wide beams around the camera, colour ramp × physical")
    for name in ("relative error", "Gauss points", "seconds", "Riemann points", "seconds", "Gauss is faster by"):
        table.add_column(name, justify="right")
    gauss, riemann = _first(run, pb.gauss_legendre, exact), _first(run, pb.riemann, exact)
    for error in ERRORS:
        (n, fast), (m, slow) = gauss[error], riemann[error]
        table.add_row(f"≤ {error:.2%}", f"{n}", f"{fast:.2f}", f"{m}", f"{slow:.2f}", f"{slow / fast:.1f}")
    console.print(table)


def _first(
    run: Callable[[Rule], tuple[np.ndarray, float]], make: Callable[[int], Rule], exact: np.ndarray
) -> dict[float, tuple[str, float]]:
    """Return, for each error, the least number of points that stays below it, and its seconds."""
    found: dict[float, tuple[str, float]] = {}
    for count in COUNTS:
        radiance, seconds = run(make(count))
        error = float(np.sqrt(np.mean((radiance - exact) ** 2)) / exact.mean())
        for limit in ERRORS:
            if error <= limit and limit not in found:
                found[limit] = str(count), seconds
        if len(found) == len(ERRORS):
            break
    return {limit: found.get(limit, (f"> {COUNTS[-1]}", float("nan"))) for limit in ERRORS}
