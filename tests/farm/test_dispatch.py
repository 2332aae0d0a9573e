"""The scheduling of a farm, with simulated workers: no pass is lost, no worker waits, and none holds up the others."""

import heapq
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photonbeams.farm.dispatch import MOST_LOST, Dispatcher, FramePart, LostError, most_passes, parts_of


def simulate(frames, workers, seconds, deaths=(), hung=()):
    """Return the time when all is done, the parts in the order in which they finish, and the number of rendered passes.

    `seconds(worker, part)` is how long a part takes, `deaths` are pairs (time, worker), `hung` workers never finish.
    """
    dispatcher, now, rendered, finished = Dispatcher(frames), 0.0, 0, []
    free_at = dict.fromkeys(workers, 0.0)
    events = [(time, "death", name, None) for time, name in deaths]
    heapq.heapify(events)
    for name in workers:
        dispatcher.add_worker(name)
    while not dispatcher.done:
        while (found := dispatcher.next(now)) is not None:
            name, part = found
            if name not in hung:
                free_at[name] = max(free_at[name], now) + seconds(name, part)
                heapq.heappush(events, (free_at[name], "done", name, part))
            else:
                heapq.heappush(events, (now + 1.0, "look", name, None))
        if not events:
            heapq.heappush(events, (now + 1.0, "look", "", None))
        now, kind, name, part = heapq.heappop(events)
        if kind == "death" and name in dispatcher.workers:
            dispatcher.lose_worker(name)
        if kind == "done" and name in dispatcher.workers:
            rendered += len(part.numbers)
            if dispatcher.finish(name, part, now):
                finished.append(part)
        assert now < 1e5, "the farm stands still"
    return now, finished, rendered


@settings(max_examples=150, deadline=None)
@given(
    frames=st.integers(1, 9), passes=st.integers(1, 40), workers=st.integers(1, 7), seed=st.integers(0, 10**6),
    deaths=st.integers(0, 6),
)  # fmt: skip
def test_every_pass_is_finished_once_whoever_dies(frames, passes, workers, seed, deaths):
    rng = random.Random(seed)
    names = [f"worker {k}" for k in range(workers)]
    parts = [parts_of([range(passes)], frames, workers, 8) for _ in range(frames)]
    dying = rng.sample(names, min(deaths, workers - 1))
    deaths_at = [(rng.uniform(0, 9), name) for name in dying]
    _, finished, rendered = simulate(parts, names, lambda _, part: rng.uniform(0.5, 2) * len(part.numbers), deaths_at)
    assert sorted((part.frame, part.numbers.start) for part in finished) == sorted(
        (frame, each.start) for frame, own in enumerate(parts) for each in own
    )
    assert sum(len(part.numbers) for part in finished) == frames * passes
    # A death costs at most the part that the worker was rendering. Slow parts are rendered twice.
    assert rendered <= frames * passes + 2 * 8 * (workers + deaths)


def test_workers_stay_with_their_frame_and_nobody_waits():
    names = ["a", "b", "c", "d"]
    parts = [parts_of([range(16)], 4, 4, 8)] * 4
    end, _, rendered = simulate(parts, names, lambda name, part: float(len(part.numbers)))
    assert end == 16 and rendered == 64
    # Four workers share a single frame.
    end, _, _ = simulate([parts_of([range(64)], 1, 4, 8)], names, lambda name, part: float(len(part.numbers)))
    assert end == 16


def test_a_hung_worker_holds_up_nothing():
    names = ["a", "b", "c", "d"]
    parts = [parts_of([range(16)], 8, 4, 4)] * 8

    def seconds(name, part):
        return float(len(part.numbers))

    usual, _, _ = simulate(parts, names, seconds)
    late, finished, _ = simulate(parts, names, seconds, hung={"b"})
    assert len(finished) == sum(map(len, parts))
    # Three workers do the work of four, and finally wait until the two parts of the hung worker are overdue.
    assert late <= usual * 4 / 3 + 2 * 4 * 4 + 2 * 4


def test_a_part_at_which_workers_die_is_blamed():
    dispatcher = Dispatcher([[range(8)]])
    for k in range(MOST_LOST):
        dispatcher.add_worker(f"worker {k}")
        name, part = dispatcher.next(0.0)
        assert part == FramePart(0, range(8))
        if k < MOST_LOST - 1:
            dispatcher.lose_worker(name)
    with pytest.raises(LostError):
        dispatcher.lose_worker(name)


def test_parts_are_aligned_and_every_worker_has_several():
    assert parts_of([range(16)], 100, 4, 8) == [range(8), range(8, 16)]
    assert parts_of([range(3, 20)], 100, 4, 8) == [range(3, 8), range(8, 16), range(16, 20)]
    assert len(parts_of([range(16)], 1, 4, 8)) == 16
    assert parts_of([], 1, 4, 8) == []
    assert [most_passes(workers) for workers in (1, 64, 65, 128, 1000)] == [8, 8, 16, 16, 128]
