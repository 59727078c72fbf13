"""Clouds of strokes are those of the tests of gestures, the browser is that of the tests of the page."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("gestures", "view")]
