"""People as a Poisson multi-Bernoulli process: every track has a probability to exist, and explains points at a rate of its own."""
