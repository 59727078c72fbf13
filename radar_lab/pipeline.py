"""The whole chain in plain Python: raw frames in, clouds, people, gestures and a hand out. The nodes run the same processors."""

from __future__ import annotations

from dataclasses import dataclass

from radar_core import ConfigError, PointCloud, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_dsp import Baseband
from radar_dsp.context import CalibratedBasebandConfig, RadarContext, load_context
from radar_gestures.classifiers.model import model_of
from radar_gestures.gesture import Gesture
from radar_gestures.make import make_recognizer
from radar_gestures.needs import lacks, needs, warning
from radar_gestures.stage import GestureConfig, config_for
from radar_tracking import HandConfig, HandTrack, HandTracker, TrackedCloud, TrackerConfig, Tracks, make_tracker


@config
class MountConfig:
    """Where the radar stands, if that was measured."""

    calibration: str = knob("", doc="file of handwave calibrate-pair with this radar's mount; empty: as the source says")


@config
class ModelledGestureConfig(GestureConfig):
    """Knobs of the gesture stage: those of the processor, and its model."""

    model: str = knob("auto", doc="gesture model: a file, one of ours by name, or auto: both of ours together")
    person: str = knob("", doc="who is there, of those whom the model knows (handwave gesture enrol); empty: anybody")


@config
class PipelineConfig:
    """Knobs of all stages, by the names that the nodes' parameters have."""

    driver: MountConfig = MountConfig()
    baseband: CalibratedBasebandConfig = CalibratedBasebandConfig()
    tracking: TrackerConfig = TrackerConfig()
    gestures: ModelledGestureConfig = ModelledGestureConfig()
    hand: HandConfig = HandConfig()

    def validate(self) -> None:
        """Raise `ConfigError` for the configuration of a processor where that of a stage belongs, which also names a file."""
        for name, wanted in (("baseband", CalibratedBasebandConfig), ("gestures", ModelledGestureConfig)):
            if not isinstance(getattr(self, name), wanted):
                raise ConfigError(f"PipelineConfig.{name} is a {type(getattr(self, name)).__name__}; give a {wanted.__name__}")


@dataclass(frozen=True, eq=False)
class PipelineResult:
    """What one frame gave."""

    cloud: PointCloud  # in the frame it came in (the sensor's, for raw frames), as it is published
    tracks: Tracks  # people, in ``room``
    gestures: tuple[Gesture, ...]  # decided with this frame
    hand: HandTrack | None  # the hand, while one is tracked


class Pipeline:
    """Baseband, people, gestures and hand, one after the other; a recognised trigger gesture starts the hand tracking.

    Parameters
    ----------
    radar : RadarInfo or RadarContext
        The radar whose frames come; a context, then the pipeline's ``context``, may hold calibrations that are in memory.
    config : PipelineConfig or None
        All knobs, the files of calibrations among them; None: the defaults.

    Raises
    ------
    ConfigError
        When a calibration or the gesture model cannot be read or does not fit, or calibrations come as context and as file.

    Attributes
    ----------
    warning : str
        What the radar does not give of what the gesture model needs; empty: it gives all.
    """

    def __init__(self, radar: RadarInfo | RadarContext, config: PipelineConfig | None = None) -> None:
        config = config if config is not None else PipelineConfig()
        self.context = _context(radar, config)
        known = self.context.radar
        self._mount = known.mount
        self._baseband = Baseband(config.baseband, known)
        self._tracker = make_tracker(config.tracking, known)
        name = config.gestures.model
        model = model_of(name, config.gestures.person)
        self._recognizer = make_recognizer(config_for(model.settings, config.gestures), model, known)
        self._hand = HandTracker(config.hand, known)
        self.warning = warning(lacks(needs(model), known), name)

    @property
    def hand(self) -> HandTracker:
        """The hand tracker, to start or stop it by hand."""
        return self._hand

    def process(self, frame: RadarFrame) -> PipelineResult:
        """Process one raw frame of the pipeline's radar. Raises `DataError` when it does not fit the radar or has a non-finite sample."""
        return self.process_cloud(self._baseband.process(frame))

    def process_cloud(self, cloud: PointCloud) -> PipelineResult:
        """Process one ready cloud, of a source that gives no raw frames.

        Parameters
        ----------
        cloud : PointCloud
            In the sensor frame or in ``room``.
        """
        levelled = cloud.to_room(self._mount)
        tracked = TrackedCloud(levelled, self._tracker.process(levelled))
        gestures = self._recognizer.process(tracked)
        for gesture in gestures:
            self._hand.gesture(gesture.name, gesture.track_id, gesture.stamp_ns)
        return PipelineResult(cloud, tracked.tracks, gestures, self._hand.process(tracked))


def _context(radar: RadarInfo | RadarContext, config: PipelineConfig) -> RadarContext:
    array, mount = config.baseband.calibration, config.driver.calibration
    if isinstance(radar, RadarInfo):
        return load_context(radar, array, mount)
    if array or mount:
        raise ConfigError("calibrations are given as a context and as files (baseband.calibration, driver.calibration); give one of them")
    return radar
