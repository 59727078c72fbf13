"""Two radars' calibration from a recording or a running graph: what `handwave calibrate-pair` does."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from rclpy.executors import SingleThreadedExecutor

from radar_core import ConfigError, DataError, PointCloud, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_lab.alignment.pair import PairCalibration, PairConfig, Walker
from radar_ros import qos
from radar_ros.bags import contents, local, read
from radar_ros.messages.convert import cloud_from_msg, frame_from_msg, info_from_msg
from radar_ros.offline import parse

Progress = Callable[[float], None]
"""Told the share that is done, 0..1."""

_WAIT = 10.0  # s: for radar/info of both radars


class _Radar:
    """One radar of a recording or graph: its walker, and its baseband where there are raw frames only."""

    def __init__(self, info: RadarInfo, settings: PairConfig) -> None:
        self.info = info
        self.walker = Walker(settings, info)
        self._baseband: Baseband | None = None

    def cloud(self, msg: Any) -> PointCloud:
        """Read a cloud."""
        return cloud_from_msg(msg)

    def from_frame(self, msg: Any) -> PointCloud:
        """Read a raw frame and make its cloud."""
        if self._baseband is None:
            self._baseband = Baseband(BasebandConfig(), self.info)
        return self._baseband.process(frame_from_msg(msg))


def from_bag(path: Path, names: Sequence[str], settings: PairConfig, progress: Progress = lambda share: None) -> tuple[Walker, Walker]:
    """Follow the person in a recording of both radars.

    Parameters
    ----------
    path : Path
        Bag with ``radar/info`` and ``radar/points`` (or else ``radar/frame``) of both.
    names : sequence of str
        Namespaces of the first and the second radar, e.g. left and right.
    settings : PairConfig
        Knobs.
    progress : callable
        Told the share that is done.

    Raises
    ------
    DataError
        Naming what is not in the recording.
    """
    counts = contents(path)
    topics = {name: _topic(path, counts, name) for name in names}
    total = sum(counts[topic] for topic in topics.values())
    kinds = {local(topic) for topic in topics.values()}
    radars: dict[str, _Radar] = {}
    spaces = {_space(name): name for name in names}
    done = 0
    for item in read(path, ("radar/info", *kinds)):
        kind = local(item.topic)
        name = spaces.get(item.topic.removesuffix(kind).strip("/"))
        if name is None or (kind != "radar/info" and item.topic != topics[name]):
            continue
        msg = parse(item.data, kind)
        if kind == "radar/info":
            info = info_from_msg(msg)
            if name in radars and radars[name].info != info:
                raise DataError(f"{path}: radar/info of {name} changes within the recording; cut it where the radar was changed")
            radars.setdefault(name, _Radar(info, settings))
            continue
        done += 1
        progress(done / total)
        if name in radars:  # frames before their info cannot be understood
            radar = radars[name]
            radar.walker.process(radar.cloud(msg) if kind == "radar/points" else radar.from_frame(msg))
    first, second = (radars[name].walker for name in names)
    return first, second


def _space(name: str) -> str:
    return name.strip("/")


def _topic(path: Path, counts: dict[str, int], name: str) -> str:
    """Full name of the clouds of a radar, or of its raw frames where there are no clouds."""
    held = {topic for topic, count in counts.items() if count}
    for kind in ("radar/points", "radar/frame"):
        if {f"/{_space(name)}/{kind}", f"/{_space(name)}/radar/info"} <= held:
            return f"/{_space(name)}/{kind}"
    radars = sorted({topic.removesuffix("/radar/info").strip("/") for topic in held if topic.endswith("/radar/info")})
    raise DataError(
        f"{path}: has no {_space(name)}/radar/points with {_space(name)}/radar/info; radars in it: {', '.join(radars) or 'none'}. Name "
        "two of them with --radars, or record both: handwave up two_radars, handwave record"
    )


class Listener:
    """Follows the person while a graph runs.

    Parameters
    ----------
    names : sequence of str
        Namespaces of the first and the second radar.
    settings : PairConfig
        Knobs.
    namespace : str
        Of the whole graph.
    """

    def __init__(self, names: Sequence[str], settings: PairConfig, namespace: str = "") -> None:
        self.node = rclpy.create_node("handwave_calibrate_pair", namespace=namespace, start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._names, self._settings = tuple(_space(name) for name in names), settings
        self._radars: dict[str, _Radar] = {}
        self.refused: list[str] = []
        for name in self._names:
            self.node.create_subscription(RadarInfoMsg, f"{name}/radar/info", self._taking_info(name), qos.LATCHED)
            self.node.create_subscription(PointCloudMsg, f"{name}/radar/points", self._taking_cloud(name), qos.sensor(depth=50))

    def _taking_info(self, name: str) -> Callable[[Any], None]:
        def take(msg: Any) -> None:
            info = info_from_msg(msg)
            if name not in self._radars:
                self._radars[name] = _Radar(info, self._settings)
            elif self._radars[name].info != info:
                self.refused.append(f"radar/info of {name} changed meanwhile")

        return take

    def _taking_cloud(self, name: str) -> Callable[[Any], None]:
        def take(msg: Any) -> None:
            if name in self._radars:
                try:
                    self._radars[name].walker.process(self._radars[name].cloud(msg))
                except DataError as error:
                    self.refused.append(str(error))

        return take

    def listen(self, duration: float, progress: Progress = lambda share: None) -> tuple[Walker, Walker]:
        """Listen for so long [s], from when both radars have told what they are, or until Ctrl-C: what was heard until then counts.

        Raises
        ------
        DataError
            When one is silent, or its clouds cannot be used.
        """
        with contextlib.suppress(KeyboardInterrupt):
            self._spin(duration, progress)
        silent = [name for name in self._names if name not in self._radars]
        if silent:
            raise DataError(
                f"no radar/info from {' and '.join(silent)} within {_WAIT:g} s; start the graph (handwave up two_radars), or choose its "
                "domain with --domain and its radars with --radars"
            )
        if self.refused:
            raise DataError(f"{len(self.refused)} messages could not be used, the first: {self.refused[0]}")
        first, second = (self._radars[name].walker for name in self._names)
        for name, walker in zip(self._names, (first, second), strict=True):
            if walker.clouds == 0:
                raise DataError(f"no clouds from {name}/radar/points; is its baseband running?")
        return first, second

    def _spin(self, duration: float, progress: Progress) -> None:
        end = time.monotonic() + _WAIT
        while len(self._radars) < 2 and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.1)
        start = time.monotonic()
        while len(self._radars) == 2 and (passed := time.monotonic() - start) < duration:
            progress(passed / duration)
            self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()


def rows(result: PairCalibration) -> Iterator[tuple[str, str, str]]:
    """Name, value and standard deviation of everything worth telling."""
    mount, found = result.mount.mount, result.alignment
    x, y, yaw = result.std
    yield "x", f"{mount.x:.4f} m", f"{x * 1e3:.1f} mm"
    yield "y", f"{mount.y:.4f} m", f"{y * 1e3:.1f} mm"
    yield "yaw", f"{np.degrees(mount.yaw):.3f} degrees", f"{np.degrees(yaw):.3f} degrees"
    yield "height", f"{mount.z:.3f} m", "as given"
    yield "tilt", f"{np.degrees(mount.tilt):.2f} degrees", "as given"
    if "offset" in found.names:
        yield "clock offset", f"{found.offset * 1e3:.1f} ms", f"{found.std['offset'] * 1e3:.1f} ms"
    yield "pairs", f"{found.pairs} in {result.seconds:.1f} s", f"worth {found.n_effective:.0f} independent ones"
    yield "agreeing", f"{found.inlier_share:.0%}", f"rms {found.rms * 1e3:.0f} mm"
    yield "condition", f"{found.condition:.1f}", f"rank {found.rank} of {len(found.names)}"


def draw(result: PairCalibration, path: Path) -> None:
    """Draw both trajectories before and after, in the first radar's levelled frame.

    Raises
    ------
    ConfigError
        When the picture cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7), layout="constrained")
    FigureCanvasAgg(figure)
    first, second, found = result.first.position, result.second.position, result.alignment
    good = found.weight >= 0.5
    pictures = (("before: each radar at the origin", second), (f"after: rms {found.rms * 1e3:.0f} mm", found.apply(second)))
    for axes, (title, moved) in zip(figure.subplots(1, 2), pictures, strict=True):
        axes.plot(first[:, 1], first[:, 0], ".", markersize=3, label=result.mount.reference)
        axes.plot(moved[:, 1], moved[:, 0], ".", markersize=3, label=result.mount.radar)
        axes.set(title=title, xlabel="y [m]", ylabel="x [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.invert_xaxis()  # as seen from above, the radar's left on the left
    wrong = found.apply(second[found.used[~good]])
    axes.plot(wrong[:, 1], wrong[:, 0], "x", color="0.5", markersize=3, label="not used")
    axes.legend(loc="lower right")
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: the picture cannot be written ({error}); give a file that ends in .png, .svg or .pdf") from None
