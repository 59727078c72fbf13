"""Tracked points to gestures: motion samples, events, features, classifier."""

from radar_gestures.activation import ActivationConfig
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.classifiers.model import load_model, save_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.events import Event, EventConfig, EventDetector
from radar_gestures.features import FEATURE_NAMES, FeatureConfig
from radar_gestures.gesture import Gesture
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig

__all__ = [
    "FEATURE_NAMES", "ActivationConfig", "Classifier", "Event", "EventConfig", "EventDetector", "FeatureConfig", "Gesture", "GestureConfig",
    "GestureModel", "GestureRecognizer", "load_model", "save_model",
]  # fmt: skip
