"""Fixtures of the emulated boards."""

from dca1000_bench import bench, tidy  # noqa: F401  (pytest finds fixtures here)
