"""The hand as an analogue input (thesis, 7.3): split from the body, followed with its velocity, mapped to a value."""

from typing import TYPE_CHECKING

from radar_core.lazy import lazily

if TYPE_CHECKING:
    from radar_tracking.hand.config import HandConfig, SplitConfig, ValueConfig
    from radar_tracking.hand.tracker import HandTracker

__all__ = ["HandConfig", "HandTracker", "SplitConfig", "ValueConfig"]
__getattr__ = lazily(__name__, {"HandConfig SplitConfig ValueConfig": "config", "HandTracker": "tracker"})
