"""`python -m benchmarks compare BASE`: this tree beside another commit, scene by scene.

Thirty small scenes are rendered by both trees in turn, by a process for each with the Python that runs this. The first
render of a scene compiles its kernels and is not timed. Then both render the same seeds. If all bits are equal, the
trees do the same; else the means are compared, relative to their noise. The whole takes about ten minutes on two
processors, once the kernels are in out/compare/.

The exit code is 1 where a mean moved beyond its noise, dots came, or a scene is no longer rendered, and 2 where BASE is
no commit. What became slower is marked, and is no failure: a machine that does other things is slower, too.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from tools import budget

from . import page, tables
from .comparison import Broken, Compared, Result, compare
from .trees import DIGITS, ROOT, commit_of, described, work_tree
from .workers import Worker

# Fewer seeds tell nothing of the noise.
LEAST_SEEDS = 2


class _Options(NamedTuple):
    """What the command line asks for: the base's commit, scenes (none: all), seeds, files to write."""

    commit: str
    only: tuple[str, ...]
    seeds: int
    write: Path | None
    page: Path | None


class _Outcome(NamedTuple):
    """What the scenes show, and the numbers of the budget by name, of the base and of this tree."""

    results: list[Result]
    budgets: tuple[dict[str, int], dict[str, int]]


def report(console: Console, arguments: Sequence[str]) -> None:
    """Compare, print the tables, and exit with 1 if something stops a landing."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks compare", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options = _options(parser, arguments)
    title = f"{described()} beside {options.commit[:DIGITS]}"
    try:
        results, budgets = _outcome(parser, options)
    except OSError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    compared = [result.outcome for result in results if isinstance(result.outcome, Compared)]
    broken = [result.outcome for result in results if isinstance(result.outcome, Broken)]
    if compared:
        console.print(tables.pictures(compared, title), tables.costs(compared))
    console.print(tables.budget(*budgets))
    for line in tables.remarks(compared, broken):
        console.print(line, markup=False)
    if options.write is not None:
        scenes = [_record(result.outcome) for result in results]
        record = {"scenes": scenes, "budgets": dict(zip(("base", "new"), budgets, strict=True))}
        options.write.write_text(json.dumps(record, indent=1) + "\n")
    if options.page is not None:
        options.page.write_text(page.written(results, title))
    if any(result.outcome.failures for result in results):
        raise SystemExit(1)


def _options(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> _Options:
    """Return what the command line asks for, or exit with 2 and a sentence."""
    parser.add_argument("base", metavar="BASE", help="the commit to compare with: a branch, a tag, HEAD~1")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="this scene; may be repeated")
    parser.add_argument("--seeds", type=int, default=LEAST_SEEDS, metavar="N", help="seeds of each scene; default: 2")
    parser.add_argument("--write", type=Path, metavar="FILE.json", help="write all numbers")
    parser.add_argument("--page", type=Path, metavar="FILE.html", help="write a page of the pictures, side by side")
    wanted = parser.parse_args(arguments)
    commit = commit_of(wanted.base)
    if commit is None:
        parser.error(f"BASE is {wanted.base!r}: expected a commit of this repository")
    if wanted.seeds < LEAST_SEEDS:
        parser.error(f"--seeds is {wanted.seeds}: expected at least {LEAST_SEEDS}")
    for path in (wanted.write, wanted.page):
        if path is not None and not path.parent.is_dir():
            parser.error(f"{path}: its folder does not exist")
    return _Options(commit, tuple(wanted.only), wanted.seeds, wanted.write, wanted.page)


def _outcome(parser: argparse.ArgumentParser, options: _Options) -> _Outcome:
    """Return what the trees show; the work tree and the processes are gone afterwards."""
    with ExitStack() as stack:
        new = stack.enter_context(Worker("new", ROOT))
        if unknown := [name for name in options.only if name not in new.scenes]:
            parser.error(f"there is no scene {unknown[0]!r}: expected {', '.join(new.scenes)}")
        tree = stack.enter_context(work_tree(options.commit))
        base_budget, new_budget = (budget.counted(budget.read(root)) for root in (tree, ROOT))
        base = stack.enter_context(Worker("base", tree))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        progress = stack.enter_context(_progress())
        scenes = [name for name in new.scenes if not options.only or name in options.only]
        task, results = progress.add_task("", total=len(scenes)), []
        for scene in scenes:
            progress.update(task, description=scene)
            results.append(compare(scene, base, new, options.seeds, folder))
            progress.advance(task)
        return _Outcome(results, (base_budget, new_budget))


def _progress() -> Progress:
    """Return a bar on the standard error."""
    columns = (
        TextColumn("{task.description:12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TimeRemainingColumn(),
    )  # fmt: skip
    return Progress(*columns, console=Console(stderr=True), transient=True)


def _record(outcome: Compared | Broken) -> dict[str, Any]:
    """Return an outcome's fields, and what follows from them, for JSON."""
    record = asdict(outcome) | {"failures": outcome.failures}
    if isinstance(outcome, Compared):
        record |= {name: getattr(outcome, name)._asdict() for name in ("change", "quiet", "worst")}
        record |= {name: getattr(outcome, name) for name in ("equal", "slower", "time_ratio", "work_ratio")}
    return record
