"""What is measured, each with its yardstick in the same run: `python -m benchmarks [NAME …]`."""
