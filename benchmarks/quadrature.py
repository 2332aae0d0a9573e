"""What six points err, by class of input drawn freely, and the cost of Gauss and Riemann points at equal error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import drjit as dr
import numpy as np
from rich.console import Console
from rich.table import Table

import photonbeams as pb
from photonbeams.estimators.points import Points
from photonbeams.quadrature import Rule
from photonbeams.runtime.device import UInt32

from .free_beams import KINDS, Draw, draw
from .scenes import RAMP, Fan, Picture, rgb

BEAMS, BEAM_RADIUS, ROUNDS = 200, 0.15, 3
EYE = (-1.2, -0.3, -2.9)  # inside the fan, across it
ERRORS = (0.01, 0.001, 0.0001)  # RMSE of the picture divided by its mean, against 64 Gauss points
COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128)


DRAWS = 20  # beams of each class
BOUNDS = (1e-2, 1e-3)


def report(console: Console) -> None:
    """Print the errors by class, and the points and the seconds that each rule needs for an error."""
    console.print(classes())
    console.print(costs())


class Counted(pb.looks.Factor):
    """A factor that counts how often it is evaluated."""

    def __init__(self, inner: pb.looks.Factor) -> None:
        self._inner, self.corners = inner, inner.corners
        self.count = dr.zeros(UInt32, 2)

    def evaluate(self, at: pb.looks.ShadingContext) -> Any:
        """Return the inner factor's value."""
        value, exponent = self.split(at)
        return value * dr.exp(exponent)

    def split(self, at: pb.looks.ShadingContext) -> Any:
        """Return the inner factor's value and exponent."""
        dr.scatter_add(self.count, UInt32(1), UInt32(dr.zeros(UInt32, dr.width(at.distance))))
        return self._inner.split(at)


def classes() -> Table:
    """Return the share of rays that err beyond two bounds, for each class of input, with evaluations a ray."""
    table = Table(title="Rays off by more than 1 % and 0.1 %; evaluations a ray: free beams, looks and cameras")
    for name in ("drawn", "class", "rays", "six points", "auto", "Riemann 12", "evaluations"):
        table.add_column(name, justify="left" if name in ("drawn", "class") else "right")
    six, sum_of_12 = pb.gauss_legendre(6), pb.riemann(12)
    for drawn, kinds in KINDS.items():
        for kind in kinds:
            draws = [draw(seed, **{drawn: kind}) for seed in range(DRAWS)]
            lit = sum(int(each.lit.sum()) for each in draws)
            shares = []
            for estimator, rule in (("frustum", six), ("auto", six), ("frustum", sum_of_12)):
                found = [(each, each.estimate(estimator, rule)) for each in draws]
                wrong = (sum(int(each.wrong(light, bound).sum()) for each, light in found) for bound in BOUNDS)
                shares.append(" ".join(f"{count / lit:6.1%}" for count in wrong))
            table.add_row(drawn, kind, f"{lit}", *shares, f"{sum(map(evaluations, draws)) / lit:.0f}")
        table.add_section()
    return table


def evaluations(given: Draw) -> int:
    """Return how often the frustum with six points evaluates a draw's look."""
    counts = []
    for origin in (given.origin, given.origin + 1e9):  # from there nothing is seen: the look is only measured
        along = Counted(given.look.along)
        look = pb.Look(along=along, across=given.look.across, eye=given.look.eye, angle=given.look.angle)
        replace(given, look=look, origin=origin).estimate("frustum", pb.gauss_legendre(6))
        counts.append(int(along.count[0]))
    return counts[0] - counts[1]


def costs() -> Table:
    """Return the points and the seconds that each rule needs for an error."""
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
    return table


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
