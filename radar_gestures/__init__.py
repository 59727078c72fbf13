"""Tracked points to gestures: motion samples, events, features, classifier; data sets and training."""

from radar_gestures.classifiers.model import GestureModel, load_model, save_model
from radar_gestures.events import Event, EventConfig, EventDetector
from radar_gestures.features import FEATURE_NAMES, FeatureConfig
from radar_gestures.recognizer import Gesture, GestureConfig, GestureRecognizer

__all__ = [
    "FEATURE_NAMES",
    "Event",
    "EventConfig",
    "EventDetector",
    "FeatureConfig",
    "Gesture",
    "GestureConfig",
    "GestureModel",
    "GestureRecognizer",
    "load_model",
    "save_model",
]
