"""Gestures named from all that a person's points do, slot by slot, without events first."""
