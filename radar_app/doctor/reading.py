"""What the doctor learns from a recording: the messages of every radar, and what the library makes of them where a stage is missing."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

from radar_app.watching.reports import reports_from_msg
from radar_core import ConfigError, DataError
from radar_core.config import load, nest
from radar_dsp import Baseband
from radar_dsp.context import load_context
from radar_lab.doctor.echoes import ordered
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.finding import Finding
from radar_ros.bags import contents, local, read
from radar_ros.messages.convert import cloud_from_msg, frame_from_msg, info_from_msg
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.offline import baseband_config, parse
from radar_tracking import TrackerConfig, make_tracker

Parameters = Mapping[str, Mapping[str, Any]]
DATA: Final = ("radar/frame", "radar/points", "tracks")
_READ: Final = ("radar/info", *DATA, "stage_status")


def from_bag(path: Path, parameters: Parameters | None = None) -> tuple[list[Evidence], list[Finding]]:
    """Read a recording.

    Parameters
    ----------
    path : Path
        The bag.
    parameters : mapping
        Of the nodes baseband and tracking: what these give is then made anew, instead of taken as it was recorded.

    Returns
    -------
    radars : list of Evidence
        One for each radar that has an info.
    findings : list of Finding
        What was wrong before anything could be looked at.

    Raises
    ------
    DataError
        When the bag cannot be read, or holds nothing of a radar.
    ConfigError
        Naming the parameter that makes no sense.
    """
    held = {topic: count for topic, count in contents(path).items() if count}
    spaces = sorted({namespace(topic) for topic in held if local(topic) in DATA[:2]})
    if not spaces:
        raise DataError(f"{path}: needs radar/frame or radar/points, but holds {', '.join(sorted(held)) or 'nothing'}; record those")
    intake = Intake({space: {local(topic) for topic in held if namespace(topic) == space} for space in spaces}, parameters)
    for item in read(path, _READ):
        intake.process(item.topic, item.stamp_ns, parse(item.data, local(item.topic)))
    return intake.finish()


class Intake:
    """Takes in the messages of all radars, and makes the clouds and tracks that were not recorded, or are wanted with other settings.

    Parameters
    ----------
    spaces : mapping
        Namespaces of the radars, each with the streams that it has.
    parameters : mapping
        See `from_bag`.
    """

    def __init__(self, spaces: Mapping[str, Collection[str]], parameters: Parameters | None = None) -> None:
        self._parameters = parameters or {}
        for stage in self._parameters:
            if stage not in ("baseband", "tracking"):
                raise ConfigError(f"doctor has no stage {stage!r} to set; stages: baseband, tracking")
        self._tracking = load(TrackerConfig, nest(self._parameters.get("tracking", {})), "--param")
        self._baseband = baseband_config({"baseband": self._parameters.get("baseband", {})})
        self._spaces = dict(spaces)
        self._chains: dict[str, Baseband] = {}
        self._early: dict[str, list[tuple[str, int, Any]]] = {space: [] for space in spaces}
        self.radars: dict[str, Evidence] = {}

    def process(self, topic: str, arrived_ns: int, msg: Any) -> None:
        """Take in a message, its full topic, and when it came [ns]; one that makes no sense is noted, and costs itself only."""
        name, space = local(topic), namespace(topic)
        if space not in self._spaces:
            return
        if name == "radar/info":
            self._describe(space, msg)
        elif space in self.radars:
            self._take(space, name, arrived_ns, msg)
        elif len(self._early[space]) < _EARLY:
            self._early[space].append((name, arrived_ns, msg))

    def _describe(self, space: str, msg: Any) -> None:
        info = info_from_msg(msg)
        if space in self.radars:
            if self.radars[space].info != info:
                self.radars[space].refuse("radar/info changes meanwhile: that of the first radar counts")
            return
        self.radars[space] = Evidence(info, space)
        if self._makes_clouds(space) and info.waveform.n_sample:
            self._chains[space] = Baseband(self._baseband, load_context(info, self._baseband.calibration).radar)
        for earlier in self._early.pop(space):
            self._take(space, *earlier)

    def _makes_clouds(self, space: str) -> bool:
        held = self._spaces[space]
        return "radar/frame" in held and ("radar/points" not in held or "baseband" in self._parameters)

    def _take(self, space: str, name: str, arrived_ns: int, msg: Any) -> None:
        evidence, chain = self.radars[space], self._chains.get(space)
        try:
            if name == "radar/frame":
                frame = frame_from_msg(msg)
                evidence.frame(frame, arrived_ns)
                if chain is not None:
                    evidence.cloud(chain.process(frame), None)
            elif name == "radar/points" and chain is None:
                evidence.cloud(cloud_from_msg(msg), arrived_ns)
            elif name == "tracks" and chain is None and "tracking" not in self._parameters:
                evidence.track(tracks_from_msg(msg), arrived_ns)
            elif name == "stage_status":
                for report in (one for one in reports_from_msg(msg) if not one.stale):
                    evidence.stage(report.stage, report.processed, report.dropped)
        except DataError as error:
            evidence.refuse(str(error))

    def finish(self) -> tuple[list[Evidence], list[Finding]]:
        """Make the tracks that are missing; gives the radars, and findings about those that do not describe themselves."""
        for evidence in self.radars.values():
            if not evidence.tracks:
                tracker = make_tracker(self._tracking, evidence.info)
                for cloud in ordered(evidence):
                    evidence.track(tracker.process(cloud), None)
        return list(self.radars.values()), [missing(space) for space in self._spaces if space not in self.radars]


def namespace(topic: str) -> str:
    """Give the namespace of a full topic, e.g. ``left`` of ``/left/radar/info``."""
    return topic.removesuffix(local(topic)).strip("/")


_EARLY: Final = 100  # messages before the info


def missing(space: str) -> Finding:
    """Say that a radar does not describe itself."""
    prefix = f"{space}/" if space else ""
    text = f"{prefix}radar/info is missing: without waveform and array nothing can be made of the data"
    driver = f"start the driver of {space or 'the radar'}"
    remedy = f"{driver}, and record everything: handwave record my_bag (radar/info is sent again to who comes later)"
    return Finding("radar info missing", True, 0.0, 1.0, "messages", text, remedy, space)
