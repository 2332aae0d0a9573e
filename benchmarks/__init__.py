"""Benchmarks, each beside a yardstick from the same run: `python -m benchmarks [NAME …]`."""

# Before Dr.Jit is imported anywhere, so that it gets an LLVM that works.
import photonbeams as photonbeams
