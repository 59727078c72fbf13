"""What a recording holds, or what the library makes of it, in the recording's own time and without a graph."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from radar_app.view.feed import Feed
from radar_app.view.maps import event_maps
from radar_app.view.messages import TOPICS, Taker
from radar_app.view.spectra import FrameTaker
from radar_app.view.zones_file import ZonesFile
from radar_core import DataError, HandwaveError, PointCloud, RadarFrame
from radar_lab.pipeline import Pipeline, PipelineConfig
from radar_ros.bags import contents, local, read
from radar_ros.messages.convert import frame_from_msg
from radar_ros.offline import open_recording, parse
from radar_tracking.tracks import Tracks
from radar_tracking.zones import LayoutConfig, ZoneMonitor

_WAIT: Final = 0.5  # s: the longest wait at once, so that the end of the page is not waited for
_RESULTS: Final = ("tracks",)


@dataclass(frozen=True)
class BagOptions:
    """How a recording is shown."""

    rate: float = 1.0  # 2 is twice as fast
    loop: bool = False
    compute: bool = False  # work out the results anew where the recording has some
    zones_file: Path | None = None  # of zones to watch instead of those of the recording
    config: PipelineConfig | None = None  # of what is worked out


class BagSource:
    """Plays a recording: its results where it holds some, else what the library makes of its raw frames or clouds.

    Parameters
    ----------
    path : Path
        Folder of the recording.
    options : BagOptions
        How it is shown.
    feed : Feed or None
        Where everything goes; None: a new one.

    Attributes
    ----------
    title, goes : str
        For people.
    feed : Feed
        What came so far.
    ended : threading.Event
        Is set when the recording is over, or cannot be read any further.
    trouble : str
        What ended it before its end; empty: nothing.

    Raises
    ------
    DataError
        When there is no such recording, or it holds neither results nor what they could be made of.
    """

    def __init__(self, path: Path, options: BagOptions | None = None, feed: Feed | None = None) -> None:
        self._path, self._options = Path(path), options or BagOptions()
        self.feed = feed if feed is not None else Feed()
        held = {local(topic) for topic, count in contents(self._path).items() if count}
        self._computed = self._options.compute or not set(_RESULTS) <= held
        if self._computed:
            open_recording(self._path)
        self._has_maps = "gestures/maps" in held and not self._computed
        self.goes = "playing"
        self.title = f"{self._path.name}, {'worked out here' if self._computed else 'as recorded'}"
        self.taker = Taker(self.feed)
        self._frames = FrameTaker(self.feed)
        self._zones = self._monitor()
        self._asked: list[LayoutConfig] = []
        self.ended, self.trouble = threading.Event(), ""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._play, name="handwave_view_bag")
        self._thread.start()

    def _monitor(self) -> ZoneMonitor | None:
        """Make what watches zones here: those of a file, or the room where nobody watched it; None: the recording says who is where."""
        file = self._options.zones_file
        if file is not None:
            return ZoneMonitor(ZonesFile(file).layout())
        return ZoneMonitor() if self._computed else None

    @property
    def note(self) -> str:
        """That the recording is over, or what is wrong with it."""
        if self.trouble:
            return f"the recording ends here: {self.trouble}"
        return self.taker.note or ("the recording is over" if self.ended.is_set() else "")

    @property
    def zones_file(self) -> Path | None:
        """Where zones are kept; None: nowhere."""
        return self._options.zones_file

    def reload_zones(self, told: Callable[[bool, str], None]) -> None:
        """Watch the zones of the file from now on; ``told`` is told that it is so."""
        assert self._options.zones_file is not None
        layout = ZonesFile(self._options.zones_file).layout()
        self._asked.append(layout)
        told(True, f"zones: {', '.join(zone.name for zone in layout.zones) or 'none'}")

    def _play(self) -> None:
        try:
            while not self._closing.is_set():
                self._once()
                if not self._options.loop:
                    break
        except HandwaveError as error:
            self.trouble = str(error)
        finally:
            self.ended.set()

    def _once(self) -> None:
        """Play it once, in its own time."""
        first, started = None, time.monotonic()
        if self._zones is not None:
            self._zones.reset()
        for stamp_ns, take in self._computing() if self._computed else self._recorded():
            first = stamp_ns if first is None else first
            while (late := (stamp_ns - first) * 1e-9 / self._options.rate - (time.monotonic() - started)) > 0:
                if self._closing.wait(min(late, _WAIT)):
                    return
            if self._closing.is_set():
                return
            take()

    def _recorded(self) -> Iterator[tuple[int, Callable[[], None]]]:
        """Give when each message was recorded [ns], and what puts it into the feed."""
        for item in read(self._path, (*TOPICS, "radar/frame")):
            name = local(item.topic)
            place = item.topic.strip("/").removesuffix(name).strip("/")
            if name == "zones" and self._zones is not None:
                continue
            yield item.stamp_ns, partial(self._put, item.data, name, place)

    def _put(self, data: bytes, name: str, place: str) -> None:
        if name == "radar/frame":
            self._frames.take(time.monotonic(), lambda: frame_from_msg(parse(data, name)))
            return
        msg = parse(data, name)
        number = self.feed.number
        self.taker.take(name, msg, place if name in ("radar/info", "stage_status") else "")
        if name == "gestures" and not self._has_maps:
            for entry in self.feed.after("gestures", number):
                self.feed.put("maps", entry.stamp_ns, event_maps(self.feed.history(), entry.value))
        if name == "tracks":
            for entry in self.feed.after("tracks", number):
                self._watch(entry.value)

    def _computing(self) -> Iterator[tuple[int, Callable[[], None]]]:
        """Give when each frame or cloud was recorded [ns], and what works out its results and puts them into the feed."""
        recording = open_recording(self._path)
        self.feed.know(recording.info)
        pipeline = Pipeline(recording.info, self._options.config)
        mount = pipeline.context.radar.mount
        for stamp_ns, item in recording.messages():
            yield stamp_ns, partial(self._work, pipeline, mount, item)

    def _work(self, pipeline: Pipeline, mount: Any, item: RadarFrame | PointCloud) -> None:
        if isinstance(item, RadarFrame):
            self._frames.take(time.monotonic(), lambda: item)
        try:
            result = pipeline.process(item) if isinstance(item, RadarFrame) else pipeline.process_cloud(item)
        except DataError as error:  # costs this frame only
            self.taker.refused += 1
            self.taker.reason = str(error)
            return
        stamp = result.cloud.stamp_ns
        self.feed.put("clouds", stamp, result.cloud.to_room(mount))
        self.feed.put("tracks", stamp, result.tracks)
        for gesture in result.gestures:
            self.feed.put("gestures", gesture.stamp_ns, gesture)
            self.feed.put("maps", gesture.stamp_ns, event_maps(self.feed.history(), gesture))
        if result.hand is not None:
            self.feed.put("hand", result.hand.stamp_ns, result.hand)
        self._watch(result.tracks)

    def _watch(self, tracks: Tracks) -> None:
        """Say who is where, with the zones of the page's own file."""
        if self._zones is None:
            return
        while self._asked:
            self._zones.change(self._asked.pop(0))
        with suppress(DataError):  # late ones say nothing of zones
            states = self._zones.process(tracks)
            self.feed.put("zones", states.stamp_ns, states)

    def close(self) -> None:
        """Stop; when it returns, the thread has ended."""
        self._closing.set()
        self._thread.join()
