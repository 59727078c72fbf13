"""Plain numpy versions of compiled loops: what the kernels have to equal."""
