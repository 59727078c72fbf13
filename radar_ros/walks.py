"""What radars saw of one person who moves, for their calibration: read from a recording, or from a running graph."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import handwave.msg
import numpy as np

from radar_core import DataError, PointCloud, RadarInfo
from radar_core.cloud import ARRAY_FIELDS
from radar_dsp import Baseband
from radar_dsp.context import CalibratedBasebandConfig, load_context
from radar_ros import qos
from radar_ros.bags import contents, local, read
from radar_ros.interrupts import Visitor
from radar_ros.messages.convert import cloud_from_msg, frame_from_msg, info_from_msg
from radar_ros.offline import baseband_config, parse

Progress = Callable[[float], None]
"""Told the share that is done, 0..1."""

_WAIT = 10.0  # s: for radar/info of all radars


class Follower(Protocol):
    """What calibrates takes in clouds, in the sensor's frame."""

    def process(self, cloud: PointCloud) -> None:
        """Take in the radar's next cloud."""


F = TypeVar("F", bound=Follower)


class _Radar(Generic[F]):
    """One radar of a recording or graph: who follows the person, and its baseband where there are raw frames only."""

    def __init__(self, info: RadarInfo, follow: Callable[[RadarInfo], F], baseband: CalibratedBasebandConfig | None = None) -> None:
        self.info = info
        self.follower = follow(info)
        self.clouds = 0
        self._config = baseband or CalibratedBasebandConfig()
        self._baseband: Baseband | None = None

    def take(self, kind: str, msg: Any) -> None:
        """Follow the person through the next message of ``radar/points``, or of ``radar/frame``, of which a cloud is made.

        Raises `DataError` for infinite values, whoever follows: NaN is what was not measured.
        """
        if kind == "radar/points":
            cloud = cloud_from_msg(msg)
            infinite = [name for name in ARRAY_FIELDS if np.isinf(getattr(cloud, name)).any()]
            if infinite:
                raise DataError(f"cloud {cloud.sequence} of {cloud.frame_id!r} has infinite values of {infinite[0]}; its sender is broken")
        else:
            if self._baseband is None:
                self._baseband = Baseband(self._config, load_context(self.info, self._config.calibration).radar)
            cloud = self._baseband.process(frame_from_msg(msg))
        self.follower.process(cloud)
        self.clouds += 1


def from_bag(
    path: Path,
    names: Sequence[str],
    follow: Callable[[RadarInfo], F],
    progress: Progress = lambda share: None,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
) -> tuple[F, ...]:
    """Follow the person in a recording of one or more radars.

    Parameters
    ----------
    path : Path
        Bag with ``radar/info`` and ``radar/points`` (or else ``radar/frame``) of each.
    names : sequence of str
        Namespaces of the radars, e.g. left and right; empty: of none.
    follow : callable
        Makes what follows the person, of the description of each radar.
    progress : callable
        Told the share that is done.
    parameters : mapping
        Of the basebands that raw frames go through, as in the graph: of ``baseband``, or of one as ``left/baseband``.

    Raises
    ------
    ConfigError
        Naming the parameter that makes no sense.
    DataError
        Naming what is not in the recording.
    """
    names, counts = [name.strip("/") for name in names], contents(path)
    basebands = {name: baseband_config(parameters or {}, name) for name in names}
    topics = {_topic(path, counts, name) for name in names}
    total = sum(counts[topic] for topic in topics)
    radars: dict[str, _Radar[F]] = {}
    done = 0
    for item in read(path, ("radar/info", *{local(topic) for topic in topics})):
        kind = local(item.topic)
        name = item.topic.removesuffix(kind).strip("/")
        if kind == "radar/info" and name in basebands:
            info = info_from_msg(parse(item.data, kind))
            if name not in radars:
                radars[name] = _Radar(info, follow, basebands[name])
            elif radars[name].info != info:
                raise DataError(f"{path}: {_joined(name, 'radar/info')} changes within the recording; cut it where the radar was changed")
        elif item.topic in topics:
            done += 1
            progress(done / total)
            if name in radars:  # frames before their info cannot be understood
                radars[name].take(kind, parse(item.data, kind))
    return tuple(radars[name].follower for name in names)


def _joined(name: str, topic: str) -> str:
    return f"{name}/{topic}" if name else topic


def _topic(path: Path, counts: dict[str, int], name: str) -> str:
    """Full name of the clouds of a radar, or of its raw frames where there are no clouds."""
    held = {topic for topic, count in counts.items() if count}
    for kind in ("radar/points", "radar/frame"):
        if {f"/{_joined(name, kind)}", f"/{_joined(name, 'radar/info')}"} <= held:
            return f"/{_joined(name, kind)}"
    radars = sorted({topic.removesuffix("radar/info").strip("/") or '""' for topic in held if topic.endswith("/radar/info")})
    raise DataError(
        f"{path}: has no {_joined(name, 'radar/points')} with {_joined(name, 'radar/info')}; radars in it: {', '.join(radars) or 'none'}. "
        "Name them (--radar, --radars), or record what you need: handwave up, handwave record"
    )


class Listener(Visitor, Generic[F]):
    """Follows the person while a graph (in ``namespace``) runs, whose radars are in the namespaces ``names``."""

    def __init__(self, names: Sequence[str], follow: Callable[[RadarInfo], F], namespace: str = "") -> None:
        super().__init__("handwave_calibrate", namespace)
        self._names, self._follow = tuple(name.strip("/") for name in names), follow
        self._radars: dict[str, _Radar[F]] = {}
        self.refused: list[str] = []
        for name in self._names:
            qos.subscribe_latched(self.node, handwave.msg.RadarInfo, _joined(name, "radar/info"), partial(self._take_info, name))
            topic = _joined(name, "radar/points")
            self.node.create_subscription(handwave.msg.PointCloud, topic, partial(self._take, name), qos.sensor(depth=50))

    def _take_info(self, name: str, msg: Any) -> None:
        info = info_from_msg(msg)
        if name not in self._radars:
            self._radars[name] = _Radar(info, self._follow)
        elif self._radars[name].info != info:
            self.refused.append(f"{_joined(name, 'radar/info')} changed meanwhile")

    def _take(self, name: str, msg: Any) -> None:
        if name in self._radars:
            try:
                self._radars[name].take("radar/points", msg)
            except DataError as error:
                self.refused.append(str(error))

    def listen(self, duration: float, progress: Progress = lambda share: None) -> tuple[F, ...]:
        """Listen for so long [s], from when all radars have told what they are, or until Ctrl-C: what was heard until then counts.

        A `DataError` says that one is silent, or that its clouds cannot be used.
        """
        end = time.monotonic() + _WAIT
        with contextlib.suppress(KeyboardInterrupt):
            while len(self._radars) < len(self._names) and time.monotonic() < end:
                self.executor.spin_once(timeout_sec=0.1)
            start = time.monotonic()
            while len(self._radars) == len(self._names) and (passed := time.monotonic() - start) < duration:
                progress(passed / duration)
                self.executor.spin_once(timeout_sec=0.1)
        silent = [_joined(name, "radar/info") for name in self._names if name not in self._radars]
        if silent:
            raise DataError(
                f"no {' and '.join(silent)} within {_WAIT:g} s; start the graph (handwave up), or choose its domain with --domain and its "
                "radars with --radar or --radars"
            )
        if self.refused:
            raise DataError(f"{len(self.refused)} messages could not be used, the first: {self.refused[0]}")
        for name in self._names:
            if self._radars[name].clouds == 0:
                raise DataError(f"no clouds from {_joined(name, 'radar/points')}; is its baseband running?")
        return tuple(self._radars[name].follower for name in self._names)
