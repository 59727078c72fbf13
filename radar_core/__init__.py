"""What a radar is: waveforms, antenna arrays, frames, point clouds, poses, and the checks that everything else relies on."""

from radar_core.antenna import AntennaArray
from radar_core.cloud import PointCloud, Quality
from radar_core.composite import CloudComposite, CloudSource, merge
from radar_core.errors import ConfigError, DataError, DeviceError, HandwaveError
from radar_core.frame import RadarFrame, RadarInfo
from radar_core.geometry import Pose
from radar_core.labels import GESTURES, NO_GESTURE, OWN_GESTURE, check_label, vocabulary
from radar_core.waveform import SPEED_OF_LIGHT, Waveform, known_symbols

__all__ = [
    "GESTURES", "NO_GESTURE", "OWN_GESTURE", "SPEED_OF_LIGHT", "AntennaArray", "CloudComposite", "CloudSource", "ConfigError",
    "DataError", "DeviceError", "HandwaveError", "PointCloud", "Pose", "Quality", "RadarFrame", "RadarInfo", "Waveform", "check_label",
    "known_symbols", "merge", "vocabulary",
]  # fmt: skip
