"""The raw frames of a rosbag2 recording, in order."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from radar_core import DataError, RadarFrame, RadarInfo
from radar_driver.sources import meant
from radar_ros.messages.convert import frame_from_msg, info_from_msg
from radar_ros.salvage import door


class BagFrames:
    """The raw frames of a bag, in order; see `radar_driver.paced.Frames`.

    ``namespace`` says which radar, where the bag holds several, e.g. ``"left"``; a bag of one radar is taken whatever its namespace.

    Raises
    ------
    DataError
        When there is no bag, it lacks radar/info or radar/frame, or it holds several radars and none in ``namespace``.
    """

    def __init__(self, path: Path, namespace: str = "") -> None:
        from rosbags.highlevel import AnyReader

        self._path, self._open = path, False
        try:
            with door(path):
                self._reader = AnyReader([path])
                self._reader.open()
                self._open = True
                place = self._radar(path, namespace.strip("/"))
                self._frames = self._connections(place + "radar/frame")
                connection, _, raw = next(self._reader.messages(connections=self._connections(place + "radar/info")))
                self.info: RadarInfo = info_from_msg(self._reader.deserialize(raw, connection.msgtype))
        except DataError:
            self.close()
            raise
        self.n_frames: int | None = sum(c.msgcount for c in self._frames)
        self.interval: float = self.info.waveform.frame_interval
        self.delay: float = 0.0
        self._next = 0
        self._messages: Iterator[Any] = iter(())

    def _connections(self, topic: str) -> list[Any]:
        return [c for c in self._reader.connections if c.topic == topic]

    def _radar(self, path: Path, namespace: str) -> str:
        """Find where the wanted radar's topics are: a namespace that begins and ends with a slash."""
        held = {c.topic for c in self._reader.connections if c.msgcount}
        radars = sorted(t.removesuffix("radar/frame") for t in held if t.endswith("/radar/frame"))
        radars = [place for place in radars if place + "radar/info" in held]
        found = meant(namespace, (place.strip("/") for place in radars))
        if found is not None:
            return f"/{found}/".replace("//", "/")
        if len(radars) == 1:
            return radars[0]
        if radars:
            raise DataError(f"{path}: holds the radars {', '.join(radars)}; give the driver the namespace of one of them")
        topics = ", ".join(sorted(held)) or "none"
        raise DataError(f"{path}: has no radar/frame with radar/info (topics: {topics}); record raw frames, or use: handwave replay")

    def frame(self, number: int) -> tuple[RadarFrame, None]:
        """Read a frame; going back starts from the front. A `DataError` says that the bag has fewer frames."""
        if number < self._next or self._next == 0:
            self._messages, self._next = self._reader.messages(connections=self._frames), 0
        with door(self._path):
            for connection, _, raw in self._messages:
                self._next += 1
                if self._next > number:
                    return frame_from_msg(self._reader.deserialize(raw, connection.msgtype)), None
        raise DataError(f"the bag ends before frame {number}")

    def close(self) -> None:
        """Close the bag."""
        if self._open:
            self._open = False
            self._reader.close()
