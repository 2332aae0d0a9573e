"""Benchmarks, each beside a yardstick from the same run: `python -m benchmarks [NAME …]`."""
