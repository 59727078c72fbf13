"""Benchmarks: ``python -m benchmarks NAME --json``. Each module here has ``run(quick) -> dict`` with flat keys and ``choices``."""
