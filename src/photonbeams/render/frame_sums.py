"""The sums of a frame: passes of all its views, which can be joined, kept in a file, and developed into layers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ..runtime.files import PathLike, atomic_file
from ..scene import Array, SceneError
from .sums import PassSums

_FORMAT = 3  # version of the file's format; stored in the state's "counts"


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
        return {"about": np.array(self.about), "counts": counts, **views, **self.development}

    @classmethod
    def of(cls, state: Mapping[str, Array]) -> FrameSums:
        """Return the sums with this `state`; raise KeyError or ValueError if it is not valid."""
        kind, count, planned, beams, tests = map(int, state["counts"])
        if kind != _FORMAT:
            raise ValueError("written by another version")
        if not (1 <= count <= 2 and 0 <= planned < 2**31 and min(beams, tests) >= 0):
            raise ValueError("its counts are out of range")
        parts: list[dict[str, Array]] = [{} for _ in range(count)]
        development = {}
        for name, each in state.items():
            place, _, rest = name.partition("/")
            if place.startswith("view "):
                parts[int(place.removeprefix("view "))][rest] = each
            elif name not in ("about", "counts"):
                development[name] = each
        views = [PassSums.restored(each) for each in parts]
        if any(each.ranges() != views[0].ranges() for each in views):
            raise ValueError("its views have different passes")
        return cls(views, planned or None, beams, tests, str(state["about"]), development)

    def save(self, path: PathLike) -> None:
        """Write the sums to the file `path`, completely or not at all; raise OSError if that fails."""
        with atomic_file(path) as file:
            np.savez(file, **self.state())  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: PathLike) -> FrameSums:
        """Return the sums that `save` wrote to `path`; raise SceneError if the file holds something else."""
        try:
            with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
                return cls.of({name: archive[name] for name in archive.files})
        except FileNotFoundError:
            raise
        except (OSError, ValueError, KeyError, EOFError, IndexError, BadZipFile, SceneError) as error:
            reason = " ".join(str(error).split())[:120]
            raise SceneError(f"{path}: expected a checkpoint of photonbeams: {reason}") from None
