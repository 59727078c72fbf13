"""The whole chain in plain Python: raw frames in, clouds, people, gestures and a hand out. The nodes run the same processors."""

from __future__ import annotations

from dataclasses import dataclass

from radar_core import PointCloud, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_gestures.recognizer import Gesture, GestureConfig, GestureRecognizer
from radar_tracking import HandConfig, HandTrack, HandTracker, PeopleTracker, TrackedCloud, TrackerConfig, Tracks


@config
class PipelineConfig:
    """Settings of all stages."""

    baseband: BasebandConfig = BasebandConfig()
    tracker: TrackerConfig = TrackerConfig()
    gestures: GestureConfig = GestureConfig()
    hand: HandConfig = HandConfig()
    model: str = knob("gestures", doc="gesture model: a file, or one of ours by name")


@dataclass(frozen=True, eq=False)
class PipelineResult:
    """What one frame gave.

    Attributes
    ----------
    cloud : PointCloud
        In the frame it came in (the sensor's, for raw frames), as it is published.
    tracks : Tracks
        People, in ``room``.
    gestures : tuple of Gesture
        Decided with this frame.
    hand : HandTrack or None
        The hand, while one is tracked.
    """

    cloud: PointCloud
    tracks: Tracks
    gestures: tuple[Gesture, ...]
    hand: HandTrack | None


class Pipeline:
    """Baseband, people, gestures and hand, one after the other; a recognised trigger gesture starts the hand tracking.

    Parameters
    ----------
    info : RadarInfo
        The radar whose frames come.
    settings : PipelineConfig or None
        All knobs; None: the defaults.

    Raises
    ------
    ConfigError
        When the gesture model cannot be read or does not fit the settings.
    """

    def __init__(self, info: RadarInfo, settings: PipelineConfig | None = None) -> None:
        settings = settings if settings is not None else PipelineConfig()
        self._mount = info.mount
        self._baseband = Baseband(settings.baseband, info)
        self._tracker = PeopleTracker(settings.tracker, info)
        self._recognizer = GestureRecognizer(settings.gestures, load_model(settings.model), info.mount)
        self._hand = HandTracker(settings.hand, info)

    @property
    def hand(self) -> HandTracker:
        """The hand tracker, to start or stop it by hand."""
        return self._hand

    def process(self, frame: RadarFrame) -> PipelineResult:
        """Process one raw frame.

        Parameters
        ----------
        frame : RadarFrame
            Of the radar that ``info`` describes.

        Raises
        ------
        DataError
            When the frame does not fit the radar or has a non-finite sample.
        """
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
