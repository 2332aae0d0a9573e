"""Loops and branches that are recorded once: they compute the same, and their state is what they assign."""

from __future__ import annotations

from typing import Any

import numpy as np

from photonbeams.numerics.syntax import syntax
from photonbeams.runtime.device import Float, UInt32

COUNT = 100
recorded: list[str] = []


def record(name: str) -> None:
    """Note that a body is recorded."""
    recorded.append(name)


@syntax
def weighed(numbers: Float, factors: list[Float], rounds: UInt32) -> tuple[list[Float], UInt32]:
    """Return for each factor Σ (factor · number) over odd rounds, each `number` times, and the number of rounds."""
    sums = [Float(0) for _ in factors]
    i = UInt32(0)
    while i < rounds:
        record("outer")
        if (i & 1) == 1:
            record("branch")
            j = UInt32(0)
            while Float(j) < numbers:
                record("inner")
                for place in range(len(factors)):
                    sums[place] += factors[place] * numbers
                j += 1
        i += 1
    return sums, i


@syntax
def replaced(state: Any, limit: UInt32) -> Any:
    """Return a dictionary whose values were assigned within a loop."""
    while state["i"] < limit:
        state["i"] += 1
        state["total"] = state["total"] + state["i"]
    return state


def test_loops_are_recorded_once_and_compute_what_they_say() -> None:
    recorded.clear()
    numbers, rounds = np.arange(COUNT) % 7, np.arange(COUNT) % 5
    sums, stops = weighed(Float(numbers), [Float(2), Float(numbers % 3)], UInt32(rounds))
    for found, factor in zip(sums, (2, numbers % 3), strict=True):
        np.testing.assert_allclose(found.numpy(), (rounds // 2) * numbers * factor * numbers)
    np.testing.assert_array_equal(stops.numpy(), rounds)
    assert recorded == ["outer", "branch", "inner"]


def test_parts_that_are_assigned_are_state() -> None:
    limit = np.arange(COUNT)
    found = replaced({"i": UInt32(0), "total": UInt32(0)}, UInt32(limit))
    np.testing.assert_array_equal(found["total"].numpy(), limit * (limit + 1) // 2)
