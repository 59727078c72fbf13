"""Bodies: one skeleton, and surfaces that echo on it."""
