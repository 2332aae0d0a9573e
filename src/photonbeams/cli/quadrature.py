"""`photonbeams quadrature`: how many points it takes to integrate the light in a beam, by Gauss and by Riemann."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any

import typer

from ..constants import MOST_POINTS
from ..scene.extras import needs
from .progress import standard_output

if TYPE_CHECKING:
    from rich.table import Table

    from ..studies.convergence import Curve

_COLUMNS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
_FLOOR = 1e-8  # of single precision; an error of 0 has no logarithm


def quadrature(
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Also plot the errors into this file.")] = None,
    rays: Annotated[
        int, typer.Option(min=1, max=100_000, metavar="N", help="Number of camera rays inside the beam.")
    ] = 1000,
    max_order: Annotated[int, typer.Option(min=1, max=256, metavar="N", help="Show rules of up to N points.")] = 24,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Random seed of the rays.")] = 0,
) -> None:
    """Show how many quadrature points the light in a beam takes: Gauss-Legendre and Riemann sums side by side.

    Rays start inside a tapered beam in fog, in random directions. For every built-in profile across the beam and every
    falloff along it, the table shows the relative error of the light along a ray with n points on each smooth piece
    of the ray: for the median ray and for the worst.

    Examples: photonbeams quadrature, or photonbeams quadrature --plot errors.png --rays 200
    """
    if plot is not None:
        _check(plot)
    found = _study(rays, max_order, seed)
    console = standard_output()
    for title, curves in found.items():
        console.print(f"{title}: median and worst error", style="bold")
        console.print(table(curves, max_order))
        console.print()
    everything = [curve for curves in found.values() for curve in curves]
    console.print(f"{rays:,} rays; n is the number of points on each smooth piece of a ray.")
    console.print(claim(everything))
    if plot is not None:
        from ..runtime.files import atomic_file

        with atomic_file(plot) as file:
            draw(found, max_order, file)
        console.print(f"Wrote {plot}", soft_wrap=True)


def _check(plot: Path) -> None:
    """Refuse a plot that cannot be written, before anything is computed."""
    from ..runtime.files import try_path

    if plot.suffix.lower() != ".png":
        raise typer.BadParameter(f"{plot} is not the name of a picture: expected FILE.png", param_hint="'--plot'")
    try_path(plot)


def _study(rays: int, max_order: int, seed: int) -> dict[str, list[Curve]]:
    """Return the curves by the titles of their tables."""
    from rich.console import Console
    from rich.progress import Progress

    from ..studies import convergence

    cases = {
        "Profiles across a beam of physical falloff": convergence.profiles(),
        "Falloffs along a beam of Epanechnikov profile": convergence.falloffs(),
    }
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("Integrating", total=sum(map(len, cases.values())))
        return {
            title: convergence.curves(some, rays, max_order, seed, lambda: bar.advance(task))
            for title, some in cases.items()
        }


# -- words -----------------------------------------------------------------------------------------------------------


def table(curves: Sequence[Curve], max_order: int) -> Table:
    """Return a table with two rows for each curve, Gauss and Riemann: the errors, and how many points are enough."""
    from rich.table import Table

    from ..studies.convergence import GAUSS_POINTS

    result = Table("", "", box=None, pad_edge=False, header_style="bold")
    orders = [n for n in _COLUMNS if n <= max_order]
    for header in (*(f"n={n}" for n in orders), "n for 1 %", f"n as {GAUSS_POINTS} Gauss"):
        result.add_column(header, justify="right")
    for curve in curves:
        result.add_row(curve.name, "Gauss", *_row(curve.gauss, orders, curve.gauss_needed(), GAUSS_POINTS))
        result.add_row("", "Riemann", *_row(curve.riemann, orders, curve.riemann_needed(), curve.riemann_equal()))
    return result


def _row(
    errors: dict[int, tuple[float, float]], orders: Sequence[int], enough: int | None, equal: int | None
) -> list[str]:
    counts = [_count(count, max(errors)) for count in (enough, equal)]
    return [" ".join(_error(each) for each in errors[n]) for n in orders] + counts


def claim(curves: Sequence[Curve]) -> str:
    """Return the Talk's claim and what was found for the worst rays, as text."""
    from ..studies.convergence import GAUSS_POINTS

    needed = [curve.gauss_needed() for curve in curves]
    riemann = _range([curve.riemann_needed() for curve in curves])
    late = [curve.name for curve, n in zip(curves, needed, strict=True) if _position(n) > GAUSS_POINTS]
    but = f" (all but {', '.join(late)})" if late else ""
    twice = sum(_position(curve.riemann_equal()) > 2 * GAUSS_POINTS for curve in curves)
    return (
        "Talk: six Gauss points are enough, and a Riemann sum needs more than twice as many.\n"
        f"Here 1 % on every ray takes {_range(needed)} Gauss points and {riemann} Riemann points; six Gauss points are "
        f"enough for {len(curves) - len(late)} of {len(curves)}{but}.\n"
        f"A Riemann sum that is as good as six Gauss points has more than twice as many for {twice} of {len(curves)}."
    )


def _position(count: int | None) -> float:
    return float("inf") if count is None else count


def _count(count: int | None, most: int) -> str:
    return f">{most}" if count is None else str(count)


def _range(counts: Sequence[int | None]) -> str:
    ordered = sorted(counts, key=_position)
    first, last = (_count(n, MOST_POINTS).replace(">", "over ") for n in (ordered[0], ordered[-1]))
    return first if first == last else f"{first} to {last}"


def _error(error: float) -> str:
    return f"{max(error, _FLOOR):.0e}".replace("e-0", "e-").replace("e+00", "")


# -- the picture -----------------------------------------------------------------------------------------------------


def draw(found: dict[str, list[Curve]], max_order: int, file: IO[bytes]) -> None:
    """Plot error against n: profiles above falloffs, the median ray beside the worst; Gauss solid, Riemann dashed."""
    with needs("plot", "a plot", "matplotlib"):
        import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(found), 2, figsize=(13, 9), dpi=110, sharex=True, sharey="row", squeeze=False)
    palette: Callable[[int], Any] = plt.get_cmap("tab20")
    for row, (title, curves) in zip(axes, found.items(), strict=True):
        for number, curve in enumerate(curves):
            for errors, style in ((curve.gauss, "-"), (curve.riemann, "--")):
                shown = [n for n in errors if n <= max_order]
                for which, panel in enumerate(row):
                    values = [max(errors[n][which], _FLOOR) for n in shown]
                    label = curve.name if style == "-" else None
                    panel.loglog(shown, values, style, color=palette(number), lw=1.4, label=label)
        for panel, name in zip(row, ("median ray", "worst ray"), strict=True):
            panel.set_title(f"{title}: {name}", fontsize=10)
            panel.axhline(0.01, color="0.4", lw=0.8, ls=":")
            panel.axvline(6, color="0.4", lw=0.8, ls=":")
            panel.grid(alpha=0.25)
        row[1].legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=9)
        row[0].set_ylabel("relative error")
    ticks = [n for n in _COLUMNS if n <= max_order]
    for panel in axes[-1]:
        panel.set_xlabel("points on each smooth piece, n")
        panel.set_xticks(ticks, [str(n) for n in ticks])
        panel.minorticks_off()
    figure.suptitle("Light along rays inside a beam, by Gauss (solid) and Riemann (dashed); dotted: 1 %, six points")
    figure.tight_layout()
    figure.savefig(file)
    plt.close(figure)
