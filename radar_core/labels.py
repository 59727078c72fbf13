"""The ten gestures: their names and their numbers in messages, models and truth (thesis, section 4.3)."""

from __future__ import annotations

from typing import Final

GESTURES: Final = ("random", "pull", "push", "swipe_up", "swipe_down", "swipe_right", "swipe_left", "rotate", "wave", "push_pull")
"""Names in the order of their numbers; "random" is any movement that is no gesture, walking included. Right and left are the user's own."""

NO_GESTURE: Final[int] = 255
"""What truth says while a person performs no gesture."""
