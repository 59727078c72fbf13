"""What a radar is: waveforms, antenna arrays, frames, point clouds, poses, and the checks that everything else relies on."""

from typing import TYPE_CHECKING

from radar_core.antenna import AntennaArray
from radar_core.cloud import PointCloud, Quality
from radar_core.composite import CloudComposite, CloudSource
from radar_core.errors import ConfigError, DataError, DeviceError, HandwaveError
from radar_core.frame import RadarFrame, RadarInfo
from radar_core.geometry import Pose
from radar_core.labels import GESTURES, NO_GESTURE, OWN_GESTURE, check_label, vocabulary
from radar_core.lazy import lazily
from radar_core.waveform import SPEED_OF_LIGHT, Waveform, known_symbols

if TYPE_CHECKING:  # only the fusion of radars needs it
    from radar_core.merging import merge

__all__ = [
    "GESTURES", "NO_GESTURE", "OWN_GESTURE", "SPEED_OF_LIGHT", "AntennaArray", "CloudComposite", "CloudSource", "ConfigError",
    "DataError", "DeviceError", "HandwaveError", "PointCloud", "Pose", "Quality", "RadarFrame", "RadarInfo", "Waveform", "check_label",
    "known_symbols", "merge", "vocabulary",
]  # fmt: skip
__getattr__ = lazily(__name__, {"merge": "merging"})
