"""A scene rendered by two trees in turn, and what differs: bits, means, dots, lines, error, time, launches, memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .differences import Block, Change, change, dots, dots_came, error, grey, line, weights, worst_block
from .protocol import Reply, Request
from .workers import Worker

Pictures = npt.NDArray[np.float32]  # (S, H, W, 3)

# A mean has moved where this many standard deviations say so, which one of 30 scenes has by chance in 500 runs,
SIGNIFICANT = 4.0
# and where it has moved by more than this, relative to itself: rounding may move all pixels to one side.
ROUNDING = 1e-5
# A scene is slower where all pairs of renders are, by more than this factor, and the mean by more than their spread.
# Between equal trees, beside other jobs that kept six processes running on two processors, six of thirty scenes had
# both pairs above 1.05, and one above 1.1.
SLOWER = 1.1


@dataclass(frozen=True)
class Side:
    """What a scene's pictures by one tree are like, and what they cost.

    `seconds` of processor time are those of the seeds, `mean` is the pictures', `error` and `line` those of
    `differences`, `launches` and `kernels` those of the first render, and `memory` is the largest that a render takes,
    in bytes.
    """

    seconds: tuple[float, ...]
    mean: float
    error: float
    dots: int
    line: float
    launches: int
    kernels: int
    memory: int | None


@dataclass(frozen=True)
class Compared:
    """A scene by two trees.

    `layers` are those whose bits differ, `unsteady` the trees that do not repeat their own bits. `quiet` is the change
    of the mean in which noisy parts weigh less.
    """

    scene: str
    base: Side
    new: Side
    layers: tuple[str, ...]
    unsteady: tuple[str, ...]
    change: Change
    quiet: Change
    worst: Block

    @property
    def equal(self) -> bool:
        """Whether all layers of all seeds have equal bits."""
        return not self.layers

    @property
    def moved(self) -> bool:
        """Whether a mean moved beyond its noise."""
        return is_significant(self.change) or is_significant(self.quiet)

    @property
    def dotted(self) -> bool:
        """Whether dots came."""
        return dots_came(self.base.dots, self.new.dots)

    @property
    def ratios(self) -> tuple[float, ...]:
        """The pairs' seconds by the new tree, in units of the base's."""
        pairs = zip(self.new.seconds, self.base.seconds, strict=True)
        return tuple(new / max(base, 1e-9) for new, base in pairs)

    @property
    def time_ratio(self) -> float:
        """The geometric mean of the ratios."""
        return float(np.exp(np.log(np.maximum(self.ratios, 1e-9)).mean()))

    @property
    def slower(self) -> bool:
        """Whether the new tree is slower beyond the spread of its pairs."""
        spread = max(self.ratios) / max(min(self.ratios), 1e-9)
        return min(self.ratios) > SLOWER and self.time_ratio > spread

    @property
    def work_ratio(self) -> float:
        """Error times the root of the time, in units of the base's; NaN without noise."""
        errors = self.new.error / self.base.error if self.base.error else float("nan")
        return errors * self.time_ratio**0.5

    @property
    def failures(self) -> tuple[str, ...]:
        """Why this scene stops a landing."""
        reasons = {"its mean moved": self.moved, "dots came": self.dotted}
        return tuple(reason for reason, holds in reasons.items() if holds)


def is_significant(change: Change) -> bool:
    """Return whether a change is beyond its noise, and beyond rounding."""
    return abs(change.z) > SIGNIFICANT and abs(change.relative) > ROUNDING


@dataclass(frozen=True)
class Broken:
    """A scene that a tree does not render, and the messages; None: it does."""

    scene: str
    base: str | None
    new: str | None

    @property
    def failures(self) -> tuple[str, ...]:
        """Why this scene stops a landing: the base renders it."""
        return ("it is no longer rendered",) if self.new and not self.base else ()


class Result(NamedTuple):
    """What a scene showed, with its pictures by the base and by the new tree, None where one has none."""

    outcome: Compared | Broken
    pictures: tuple[Pictures, Pictures] | None


def compare(scene: str, base: Worker, new: Worker, seeds: int, folder: Path) -> Result:
    """Render a scene by two trees, with seeds from 0 on.

    The first render compiles the kernels and is not timed, and so both trees' may run at once; it has the first seed's
    samples, and must have its bits. The timed renders follow in the order base, new, new, base, so that a machine that
    becomes slower or faster slows both.
    """
    workers = (base, new)
    for worker in workers:
        worker.send(Request(scene, 0, str(_file(folder, worker, 0)), counts=True))
    first = [worker.receive() for worker in workers]
    if any(reply.error for reply in first):
        return Result(Broken(scene, *(reply.error for reply in first)), None)
    replies: dict[str, list[Reply]] = {worker.name: [] for worker in workers}
    for seed in range(seeds):
        for worker in workers if seed % 2 == 0 else reversed(workers):
            replies[worker.name].append(worker.ask(Request(scene, seed, str(_file(folder, worker, seed)))))
    both = [replies[worker.name] for worker in workers]
    if any(reply.error for side in both for reply in side):
        return Result(Broken(scene, *(_message(side) for side in both)), None)
    pictures = tuple(np.stack([np.load(_file(folder, worker, seed)) for seed in range(seeds)]) for worker in workers)
    sides = [_side(*parts) for parts in zip(first, both, pictures, strict=True)]
    grays = [grey(picture) for picture in pictures]
    weight = weights(*grays)
    outcome = Compared(
        scene=scene,
        base=sides[0],
        new=sides[1],
        layers=_differing(*both),
        unsteady=_unsteady(workers, first, both),
        change=change(*grays),
        quiet=change(*(weight * gray for gray in grays)),
        worst=worst_block(*grays),
    )
    return Result(outcome, pictures)


def _file(folder: Path, worker: Worker, seed: int) -> Path:
    return folder / f"{worker.name}.{seed}.npy"


def _message(replies: Sequence[Reply]) -> str | None:
    """Return why renders failed, or None."""
    return next((reply.error for reply in replies if reply.error), None)


def _side(first: Reply, replies: Sequence[Reply], pictures: Any) -> Side:
    peaks = [reply.memory for reply in replies if reply.memory is not None]
    gray = grey(pictures)
    return Side(
        seconds=tuple(reply.seconds for reply in replies),
        mean=float(gray.mean()),
        error=error(gray),
        dots=dots(pictures),
        line=line(gray),
        launches=first.launches,
        kernels=first.kernels,
        memory=max(peaks, default=None),
    )


def _differing(base: Sequence[Reply], new: Sequence[Reply]) -> tuple[str, ...]:
    """Return the layers that both trees have, and whose bits differ for some seed."""
    return tuple(
        name for name, digest in base[0].digests.items()
        if name in new[0].digests
        and any(one.digests[name] != other.digests[name] for one, other in zip(base, new, strict=True))
    )  # fmt: skip


def _unsteady(workers: Sequence[Worker], first: Sequence[Reply], both: Sequence[Sequence[Reply]]) -> tuple[str, ...]:
    """Return the names of the trees whose second render with a seed has other bits than the first."""
    triples = zip(workers, first, both, strict=True)
    return tuple(worker.name for worker, once, again in triples if once.digests != again[0].digests)
