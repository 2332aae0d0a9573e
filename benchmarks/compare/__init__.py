"""Compare this tree with another commit: `python -m benchmarks compare BASE`."""

from .command import report as report
