"""Benchmarks: run one with `python -m tests.benchmarks.NAME`; they print and never fail."""
