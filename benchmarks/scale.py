"""A thousand machines, simulated: the farm's scheduling policy with measured task times, failures and stragglers.

Run `python -m benchmarks scale`. The dispatcher is that of the real farm; workers, network and time are simulated.
"""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from rich.console import Console
from rich.live import Live
from rich.table import Table

import photonbeams as pb
from photonbeams.farm.dispatch import Dispatcher, FramePart, most_passes, parts_of
from photonbeams.render.films.sums import BLOCK


@dataclass(frozen=True)
class Machine:
    """The properties of a simulated farm.

    Attributes
    ----------
    workers
        Number of machines.
    pass_seconds, begin_seconds
        Seconds of a pass, and of the first part of a frame on a worker (its world, its guiding).
    part_bytes, link
        Bytes that a part sends to the client, and bytes a second that the client takes.
    overhead
        Seconds that the client spends on a part: submitting, joining.
    failures
        Failures of a worker per hour; it is replaced after `replaced` seconds.
    slow, factor
        The fraction of workers that are slower, and by which factor.
    """

    workers: int
    pass_seconds: float
    begin_seconds: float
    part_bytes: float
    link: float = 1.25e9 / 1.25
    overhead: float = 0.01
    failures: float = 0.05
    replaced: float = 120.0
    slow: float = 0.02
    factor: float = 5.0
    seed: int = 0


@dataclass(frozen=True)
class Simulated:
    """The result: seconds, and the fractions of useful worker time, passes rendered twice, and busy client time."""

    seconds: float
    efficiency: float
    twice: float
    busy: float


def _sent(part: FramePart) -> int:
    """Return how many sums of pixels a part sends: one for each block, but a single one for a frame's first part."""
    numbers = part.numbers
    return 1 if numbers.start == 0 else numbers.stop // BLOCK - -(-numbers.start // BLOCK) or 1


def simulate(machine: Machine, frames: int, passes: int) -> Simulated:
    """Simulate the rendering of frames with a number of passes each."""
    rng = random.Random(machine.seed)
    names = [f"{k}" for k in range(machine.workers)]
    slow = {name: machine.factor if rng.random() < machine.slow else 1.0 for name in names}
    parts = [parts_of([range(passes)], frames, machine.workers, most_passes(machine.workers)) for _ in range(frames)]
    dispatcher, now = Dispatcher(parts), 0.0
    free, last = dict.fromkeys(names, 0.0), dict.fromkeys(names, -1)
    born = dict.fromkeys(names, 0)
    events: list[tuple[float, int, str, str, FramePart | None, int]] = []
    count = 0

    def at(time: float, kind: str, name: str, part: FramePart | None = None) -> None:
        nonlocal count
        count += 1
        heapq.heappush(events, (time, count, kind, name, part, born[name]))

    for name in names:
        dispatcher.add_worker(name)
        if machine.failures:
            at(rng.expovariate(machine.failures / 3600), "lost", name)
    rendered, client, client_busy = 0, 0.0, 0.0
    at(0.0, "look", names[0])
    while not dispatcher.done:
        while (found := dispatcher.next(now)) is not None:
            name, part = found
            begin = machine.begin_seconds if last[name] != part.frame else 0.0
            last[name] = part.frame
            work = slow[name] * (begin + len(part.numbers) * machine.pass_seconds) * rng.lognormvariate(0, 0.1)
            free[name] = max(free[name], now) + work
            at(free[name], "done", name, part)
        now, _, kind, name, part, life = heapq.heappop(events)
        if kind == "look":
            at(now + 1.0, "look", names[0])
        elif kind == "lost" and name in dispatcher.workers:
            dispatcher.lose_worker(name)
            born[name] += 1
            at(now + machine.replaced, "back", name)
        elif kind == "back":
            free[name], last[name] = now, -1
            dispatcher.add_worker(name)
            at(now + rng.expovariate(machine.failures / 3600), "lost", name)
        elif kind == "done" and part is not None and life == born[name]:
            spent = machine.overhead + machine.part_bytes * _sent(part) / machine.link
            client, client_busy = max(client, now) + spent, client_busy + spent
            rendered += len(part.numbers)
            at(client, "taken", name, part)
        elif kind == "taken" and part is not None:
            dispatcher.finish(name, part, now)
    useful = frames * passes * machine.pass_seconds
    return Simulated(
        max(now, client), useful / (machine.workers * max(now, client)), rendered / (frames * passes) - 1,
        client_busy / max(now, client),
    )  # fmt: skip


#: Bytes per pixel that a task sends, as float32: radiance of surfaces and of a light group, transmittance, alpha,
#: depth, and the two sums from which the error is estimated.
PIXEL_BYTES = 4 * (3 + 3 + 3 + 1 + 1 + 2)
#: Pixels, passes of a frame, and seconds of a pass and of the start of a frame, measured on two processors with AVX2.
SHOTS = {
    "keyhole, 1280 × 720": (1280 * 720, 64, 0.95, 0.7),
    "keyhole, 4K": (3840 * 2160, 64, 6.3, 2.8),
    "keyhole, 8 bounces": (1280 * 720, 64, 7.6, 6.7),
}
WORKERS = (10, 100, 1000)
FRAMES = 2000
HOUR_COST = 0.04  # dollars for an hour of two virtual processors, on demand


EXAMPLES = Path(__file__).parents[1] / "examples"
#: Scenes of the gallery, and the size and passes of their final frames.
GALLERY = (
    "keyhole/keyhole.usda", "shaft/physical.usda", "forest/forest.usda", "magic/magic.usda",
    "concert/concert.usda", "mitsuba/slits.xml", "mitsuba/glass_ball.xml", "mitsuba/flask.xml",
    "mitsuba/mirrors.xml", "mitsuba/cornell_fog.xml", "mitsuba/cloud.xml",
)  # fmt: skip
GALLERY_WIDTH, GALLERY_PASSES = 1280, 64


def report(console: Console) -> None:
    """Print the cost of the gallery's frames, and the efficiency of farms of more and more machines."""
    gallery(console)
    farms(console)


def gallery(console: Console) -> None:
    """Print the time of a frame of each gallery scene on this machine, and what it would cost on a rented one."""
    table = Table(title=f"Frames of {GALLERY_PASSES} passes, {GALLERY_WIDTH} pixels wide, once a worker is warm")
    for name in ("shot", "first pass, s", "further passes, s", "minutes a frame", "dollars a frame"):
        table.add_column(name, justify="right" if name != "shot" else "left")
    with Live(table, console=console):  # it takes long, so rows appear as they are measured
        for name in GALLERY:
            shot = pb.Shot.open(EXAMPLES / name)
            times = []
            for passes in (1, 1, 4):  # the first one compiles
                begin = perf_counter()
                shot.render(passes=passes, width=GALLERY_WIDTH)
                times.append(perf_counter() - begin)
            each = (times[2] - times[1]) / 3
            seconds = times[1] + (GALLERY_PASSES - 1) * each
            cost = seconds / 3600 * HOUR_COST
            table.add_row(name, f"{times[1]:.1f}", f"{each:.2f}", f"{seconds / 60:.1f}", f"{cost:.4f}")


def farms(console: Console) -> None:
    """Print the efficiency of farms of more and more machines."""
    table = Table(
        title=f"{FRAMES:,} frames on simulated farms; a worker is lost every 20 hours, one of 50 is five times slower",
        caption="efficiency: passes' own time over that of all workers; client: how busy the machine that joins is",
    )
    for name in ("shot", "workers", "hours", "efficiency", "rendered twice", "client busy", "GB/s", "dollars a frame"):
        table.add_column(name, justify="right" if name != "shot" else "left")
    for name, (pixels, passes, seconds, begin) in SHOTS.items():
        for workers in WORKERS:
            part = PIXEL_BYTES * pixels
            found = simulate(Machine(workers, seconds, begin, part), FRAMES, passes)
            parts = parts_of([range(passes)], FRAMES, workers, most_passes(workers))
            rate = part * FRAMES * sum(_sent(FramePart(0, each)) for each in parts) / found.seconds / 1e9
            cost = workers * found.seconds / 3600 * HOUR_COST / FRAMES
            table.add_row(
                name, f"{workers:,}", f"{found.seconds / 3600:.2f}", f"{found.efficiency:.0%}", f"{found.twice:.1%}",
                f"{found.busy:.0%}", f"{rate:.2f}", f"{cost:.3f}",
            )  # fmt: skip
    console.print(table)
