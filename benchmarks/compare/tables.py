"""The comparison's tables, of pictures, of costs and of the budget, and the sentences below them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rich.table import Table

from .comparison import Broken, Compared, Side, is_significant
from .differences import Change

_ARROW = " → "


def pictures(compared: Sequence[Compared], title: str) -> Table:
    """Return a table of how pictures differ."""
    caption = (
        "Changes are followed by their Z; in the quiet mean, noisy blocks of pixels weigh less. Lines: the most "
        "conspicuous row or column, in units of the median one."
    )
    table = Table(title=title, caption=caption)
    table.add_column("scene", no_wrap=True)
    for name in ("mean", "quiet mean", "worst block", "error", "dots", "lines"):
        table.add_column(name, justify="right", no_wrap=True)
    for scene in compared:
        table.add_row(scene.scene, *_change_cells(scene), *_quality_cells(scene))
    return table


def _change_cells(scene: Compared) -> tuple[str, str, str]:
    """Return the cells of both means, with their Z, and of the worst block."""
    if "rgba" not in scene.layers:
        return "bits equal" if scene.equal else f"bits equal, not {', '.join(scene.layers)}", "", ""
    worst = scene.worst
    block = f"{worst.relative:+.1%}, {worst.z:+.1f} at {worst.x}, {worst.y}"
    return _mean_cell(scene.change), _mean_cell(scene.quiet), block


def _mean_cell(change: Change) -> str:
    text = f"{change.relative:+.3%}, {change.z:+.1f}"
    return _bad(text) if is_significant(change) else text


def _quality_cells(scene: Compared) -> tuple[str, str, str]:
    """Return the cells of the error, dots and lines, which are marked where the new tree has more dots."""
    base, new = scene.base, scene.new
    dotted = _pair(f"{base.dots}", f"{new.dots}")
    return (
        _pair(f"{base.error:.1%}", f"{new.error:.1%}"),
        _bad(dotted) if scene.dotted else dotted,
        _pair(f"{base.line:.0f}", f"{new.line:.0f}"),
    )


def costs(compared: Sequence[Compared]) -> Table:
    """Return a table of what pictures cost."""
    caption = (
        "Seconds are of processor time, the mean of the seeds; ▲: slower beyond the spread of the pairs. Launches are "
        "those of the first render, kernels those that no earlier scene had. MiB: the peak of the process' memory "
        "above what it had before."
    )
    table = Table(title="Costs", caption=caption, show_footer=True)
    totals = [sum(_mean_seconds(side) for side in sides) for sides in _by_side(compared)]
    footers = {"CPU s": _pair(*(f"{seconds:.1f}" for seconds in totals)), "scene": "all"}
    for name in ("scene", "error × √time", "CPU s", "new / base", "launches", "kernels", "MiB"):
        justify = "left" if name == "scene" else "right"
        table.add_column(name, footers.get(name, ""), justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for scene in compared:
        table.add_row(scene.scene, *_cost_cells(scene))
    return table


def _by_side(compared: Sequence[Compared]) -> tuple[list[Side], list[Side]]:
    """Return all scenes' figures by the base and by the new tree."""
    return [scene.base for scene in compared], [scene.new for scene in compared]


def _mean_seconds(side: Side) -> float:
    return sum(side.seconds) / len(side.seconds)


def _cost_cells(scene: Compared) -> tuple[str, ...]:
    base, new = scene.base, scene.new
    ratio = f"{scene.time_ratio:.2f} ({min(scene.ratios):.2f}–{max(scene.ratios):.2f})"
    return (
        "–" if scene.work_ratio != scene.work_ratio else f"{scene.work_ratio:.2f}",
        _pair(f"{_mean_seconds(base):.1f}", f"{_mean_seconds(new):.1f}"),
        f"[yellow]▲ {ratio}[/]" if scene.slower else ratio,
        _pair(f"{base.launches}", f"{new.launches}"),
        _pair(f"{base.kernels}", f"{new.kernels}"),
        _pair(_mebibytes(base.memory), _mebibytes(new.memory)),
    )


def budget(base: Mapping[str, int], new: Mapping[str, int]) -> Table:
    """Return a table of the budget's numbers that differ, and of the whole's."""
    table = Table(title="Budget: tokens and modules of rooms, and what the whole has")
    table.add_column("number", no_wrap=True)
    for name in ("base", "new", "more"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in sorted(base.keys() | new.keys()):
        before, after = base.get(name, 0), new.get(name, 0)
        if before != after or name.startswith("whole"):
            table.add_row(name, f"{before}", f"{after}", f"{after - before:+d}" if after != before else "")
    tokens = [sum(count for name, count in each.items() if name.endswith(".tokens")) for each in (base, new)]
    table.add_row("all tokens", *map(str, tokens), f"{tokens[1] - tokens[0]:+d}")
    return table


def _mebibytes(count: int | None) -> str:
    return "" if count is None else f"{count / 2**20:.0f}"


def _pair(base: str, new: str) -> str:
    """Return what both trees have, once if it is the same."""
    return base if base == new else f"{base}{_ARROW}{new}"


def _bad(text: str) -> str:
    return f"[bold red]{text}[/]"


def remarks(compared: Iterable[Compared], broken: Iterable[Broken]) -> list[str]:
    """Return a sentence for each scene that fails, is not repeated by its tree, or became slower."""
    lines = []
    for lost in broken:
        messages = {"base": lost.base, "new": lost.new}
        lines += [f"{lost.scene}, {tree}: {message}" for tree, message in messages.items() if message]
    for scene in compared:
        lines += [f"{scene.scene}: {reason}" for reason in scene.failures]
        lines += [f"{scene.scene}: {tree} has other bits when it renders a seed again" for tree in scene.unsteady]
        if scene.slower:
            lines.append(f"{scene.scene}: slower beyond the spread of its pairs, which is no failure")
    return lines
