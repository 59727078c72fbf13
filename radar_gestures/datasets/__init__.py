"""Labelled samples: simulated ones, recorded ones, and what is read from them."""
