"""Labelled samples of gestures: simulated, recorded, published."""
