"""Motions: what people do, as postures over time."""
