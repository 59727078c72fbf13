"""Pose estimators, chosen by name."""

from __future__ import annotations

from typing import Literal

from radar_core.config import config, knob
from radar_lab.camera.markers import MarkerConfig, MarkerFinder
from radar_lab.camera.mediapipe_pose import MediapipeConfig, MediapipePose
from radar_lab.camera.pose import PoseEstimator


@config
class PoseConfig:
    """Which estimator finds the joints."""

    estimator: Literal["markers", "mediapipe"] = knob(
        "markers",
        doc="markers: coloured markers that the person wears; mediapipe: a person without markers (pip install 'handwave[camera]')",
    )
    markers: MarkerConfig = MarkerConfig()
    mediapipe: MediapipeConfig = MediapipeConfig()


def make_estimator(config: PoseConfig) -> PoseEstimator:
    """Make the estimator that a configuration names.

    Raises `ConfigError` when what it needs is not installed, or its model is not there.
    """
    return MediapipePose(config.mediapipe) if config.estimator == "mediapipe" else MarkerFinder(config.markers)
