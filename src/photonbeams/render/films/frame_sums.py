"""The sums of a frame: passes of all its views, which can be joined, kept in a file, and developed into layers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...runtime.files import PathLike, atomic_file
from ...runtime.inputs import arrays
from ...scene import Array, SceneError
from .sums import PassSums

_FORMAT = 4  # version of the file's format; stored in the state's "counts"

# Members of a file beside the sums and the development; `_NAMES` lists all others, so that none can be lost.
_ABOUT, _COUNTS, _NAMES = "about", "counts", "names"


@dataclass
class FrameSums:
    """The sums of some passes of a frame.

    Attributes
    ----------
    views
        The sums of each view.
    planned
        How many passes were planned, which determines the pixels' samples and the slices of the shutter; None: any
        number.
    beams, tests
        Numbers of beams and of ray–beam tests in all passes.
    about
        A hash of everything that has to be the same for passes to be of one picture.
    development
        What else is needed to make a picture of the sums, as arrays by name.
    """

    views: list[PassSums]
    planned: int | None
    beams: int = 0
    tests: int = 0
    about: str = ""
    development: Mapping[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of passes."""
        return len(self.views[0])

    def ranges(self) -> list[range]:
        """Return the passes as ranges, in order, with gaps between them."""
        return self.views[0].ranges()

    def missing(self, passes: int) -> list[range]:
        """Return which of the first `passes` passes are missing, as ranges."""
        ends = [0, *(end for each in self.ranges() for end in (each.start, each.stop))]
        ends.append(max(passes, ends[-1]))
        return [range(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b]

    def error(self) -> float:
        """Return the relative standard error of the view with the largest one; NaN if it is not known."""
        return max(each.error() for each in self.views)

    def join(self, other: FrameSums) -> None:
        """Add the passes of `other`; raise SceneError if they are of another picture, or some are there already."""
        if (other.about, other.planned, len(other.views)) != (self.about, self.planned, len(self.views)):
            raise SceneError("is of another scene or of other settings: expected passes of one picture")
        for own, more in zip(self.views, other.views, strict=True):
            own.join(more)
        self.beams, self.tests = self.beams + other.beams, self.tests + other.tests

    def state(self) -> dict[str, Array]:
        """Return all fields as arrays by name."""
        counts = np.array([_FORMAT, len(self.views), self.planned or 0, self.beams, self.tests])
        views = {f"view {k}/{name}": each for k, own in enumerate(self.views) for name, each in own.state().items()}
        state = {**views, **self.development}
        return {_ABOUT: np.array(self.about), _COUNTS: counts, _NAMES: np.array(sorted(state), dtype=np.str_), **state}

    @classmethod
    def of(cls, state: Mapping[str, Array]) -> FrameSums:
        """Return the sums with this `state`; raise ValueError if it is not valid."""
        count, planned, beams, tests = _counts(state.get(_COUNTS))
        rest = {name: each for name, each in state.items() if name not in (_ABOUT, _COUNTS, _NAMES)}
        names = {str(name) for name in np.ravel(state.get(_NAMES, ()))}
        if lost := names.symmetric_difference(rest):
            raise ValueError(f"it has {len(rest)} arrays and names {len(names)}, which differ by {min(lost)!r:.60}")
        about = state.get(_ABOUT)
        if about is None or about.shape or about.dtype.kind != "U":
            raise ValueError("it does not say of which picture it is")
        parts: list[dict[str, Array]] = [{} for _ in range(count)]
        development = {}
        for name, each in rest.items():
            view, _, own = name.partition("/")
            if not view.startswith("view "):
                development[name] = each
            elif view in (known := [f"view {k}" for k in range(count)]):
                parts[known.index(view)][own] = each
            else:
                raise ValueError(f"it has sums of {view[:40]!r}: expected {count} views")
        views = [PassSums.restored(each) for each in parts]
        if any(each.ranges() != views[0].ranges() for each in views):
            raise ValueError("its views have different passes")
        return cls(views, planned or None, beams, tests, str(about), development)

    def save(self, path: PathLike) -> None:
        """Write the sums to the file `path`, completely or not at all; raise OSError if that fails."""
        with atomic_file(path) as file:
            np.savez(file, **self.state())  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: PathLike) -> FrameSums:
        """Return the sums that `save` wrote to `path`; raise SceneError if the file holds something else."""
        try:
            return cls.of(arrays(path))
        except ValueError as error:
            reason = " ".join(str(error).split())[:160]
            raise SceneError(f"{path}: expected a checkpoint of photonbeams, but {reason}") from None


def _counts(given: Any) -> tuple[int, int, int, int]:
    """Return the numbers of views, planned passes, beams and tests in a state; raise ValueError if they are none."""
    if not (isinstance(given, np.ndarray) and given.shape == (5,) and given.dtype.kind in "iu"):
        raise ValueError("it has no counts")
    kind, views, planned, beams, tests = map(int, given)
    if kind != _FORMAT:
        raise ValueError("it is written by another version")
    if not (1 <= views <= 2 and 0 <= planned < 2**31 and min(beams, tests) >= 0):
        raise ValueError("its counts are out of range")
    return views, planned, beams, tests
