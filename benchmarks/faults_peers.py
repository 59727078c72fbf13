"""Broken and hostile peers: what others publish on a graph's topics and ask of its services."""

from __future__ import annotations

import array
import copy
import math
import random
from collections.abc import Callable
from typing import Any, Final

import handwave.msg
import numpy as np
from handwave.srv import TrackHand
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from benchmarks.faults_graph import Running, watched
from benchmarks.faults_rows import Fault
from radar_core import Pose, RadarInfo
from radar_core.cloud import ARRAY_FIELDS
from radar_ros.messages.convert import from_time, info_to_msg, to_time

MEANS: Final = "real publisher"
_HOUR: Final = 3600 * 10**9  # ns
_TIMES: Final = 20  # messages of a fault
_LAST: Final = 2**64 - 1
Change = Callable[[Any, int], Any]


def _sent(topic: str, change: Change, times: int = _TIMES, pause: float = 0.03) -> Callable[[Running], None]:
    """Publish copies of the last message of a topic with something changed."""

    def inject(running: Running) -> None:
        with running.peer(topic) as publisher:
            for number in range(times):
                msg = copy.deepcopy(running.ear.last[topic])
                publisher.publish(change(msg, number) or msg)
                running.live(pause)

    return inject


def _paired(change: Change) -> Callable[[Running], None]:
    """Publish tracks with something changed together with a cloud of the same stamp, so that stages take them for a pair."""

    def inject(running: Running) -> None:
        with running.peer("tracks") as tracks, running.peer("radar/points") as clouds:
            for number in range(_TIMES):
                cloud, msg = copy.deepcopy(running.ear.last["radar/points"]), copy.deepcopy(running.ear.last["tracks"])
                cloud.header.stamp = msg.header.stamp = to_time(from_time(cloud.header.stamp) + 7)
                msg.point_track_id = array.array("i", [-1] * len(cloud.x))
                change(msg, number)
                tracks.publish(msg)
                clouds.publish(cloud)
                running.live(0.03)

    return inject


def _set(**fields: Any) -> Change:
    """Change fields of a message; what can be called gets the number of the message."""

    def change(msg: Any, number: int) -> None:
        for name, value in fields.items():
            setattr(msg, name, value(number) if callable(value) else value)

    return change


def _later(msg: Any, number: int) -> None:
    msg.header.stamp = to_time(from_time(msg.header.stamp) + _HOUR + number * 10**7)


def _earlier(msg: Any, _: int) -> None:
    msg.header.stamp = to_time(max(from_time(msg.header.stamp) - _HOUR, 0))


def _before_1970(msg: Any, _: int) -> None:
    msg.header.stamp.sec = -5


def _track(**fields: Any) -> Change:
    def change(msg: Any, _: int) -> None:
        track = handwave.msg.Track(id=1, status=1)
        for name, value in fields.items():
            setattr(track, name, value)
        msg.tracks = [track]

    return change


def _info(**fields: Any) -> Change:
    return lambda msg, number: _set(**fields)(msg, number)


def _many_receivers(msg: Any, _: int) -> None:
    msg.rx_y_m = msg.rx_z_m = np.linspace(0, 1, 2000)


def _huge(points: int) -> Change:
    def change(msg: Any, _: int) -> None:
        msg.x = array.array("f", bytes(4 * points))  # one array: of more, fragments are lost, and the cloud never arrives

    return change


def _infinite(msg: Any, _: int) -> None:
    for name in ARRAY_FIELDS:
        setattr(msg, name, [math.inf if name in "xyz" else 1.0])


def _spoilt(field: str, value: float) -> Change:
    def change(msg: Any, number: int) -> None:
        values = np.array(getattr(msg, field))
        if len(values):
            values[number % len(values)] = value
        setattr(msg, field, values.tolist())

    return change


def _zone(**fields: Any) -> Change:
    def change(msg: Any, _: int) -> None:
        zone = handwave.msg.Zone(name="bad", polygon=[0.0, 0.0, 1.0, 0.0, 1.0, 1.0], z_low=0.0, z_high=2.0)
        for name, value in fields.items():
            setattr(zone, name, value)
        msg.zones = [zone]

    return change


def _random_names(msg: Any, number: int) -> None:
    """Texts of which no two are alike, in a message that contradicts itself."""
    letters = random.Random(number)
    msg.header.frame_id = "".join(letters.choice("abcdefghijklmnopqrstuvwxyz") for _ in range(12))
    msg.n_chirp += 1


def _bytes(topic: str, data: bytes) -> Callable[[Running], None]:
    """Publish bytes that are no message."""

    def inject(running: Running) -> None:
        with running.peer(topic) as publisher:
            for _ in range(_TIMES):
                publisher.publish(data)
                running.live(0.03)

    return inject


def _large_clouds(running: Running) -> list[str]:
    """Publish clouds of 70,000 points, and look at what the nodes hold afterwards."""
    names = ("tracking", "gestures", "hand")
    before = {name: running.process(name).memory_info().rss for name in names}
    _sent("radar/points", _huge(70_000), 5, 0.2)(running)
    running.live(2.0)
    grown = {name: (running.process(name).memory_info().rss - size) >> 20 for name, size in before.items()}
    return [f"memory: {name} grew by {size} MB" for name, size in grown.items()]


def _called(service: str, kind: Any, request: Any, words: Callable[[Any], str]) -> Callable[[Running], list[str]]:
    """Ask a service for something that it has to refuse."""

    def inject(running: Running) -> list[str]:
        client = running.ear.node.create_client(kind, service)
        running.live(10.0, client.service_is_ready)
        future = client.call_async(request)
        running.live(10.0, future.done)
        said = words(future.result()) if future.done() else ""
        running.ear.node.destroy_client(client)
        return [said]

    return inject


def _parameter(node: str, name: str, value: Any) -> Callable[[Running], list[str]]:
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return _called(f"{node}/set_parameters", SetParameters, request, lambda response: response.results[0].reason)


def _cut_short(msg: Any, _: int) -> None:
    msg.data = msg.data[:-2]


def _refused(name: str, words: str, topic: str, change: Change, **more: Any) -> Fault:
    return Fault(name, MEANS, words, watched(_sent(topic, change)), **more)


_HAND: Final = TrackHand.Request(enable=True, track_id=4_000_000)
_OTHER: Final = info_to_msg(RadarInfo(mount=Pose(z=9.0)), 0)
FAULTS: Final = (
    _refused("tracks an hour ahead", "went back in time", "tracks", _later),
    _refused("clouds an hour ahead", "went back in time", "radar/points", _later),
    _refused("frames an hour ahead", "went back in time", "radar/frame", _later),
    _refused("clouds an hour ago", "went back in time", "radar/points", _earlier),
    _refused("clouds before 1970", "went back in time|stamp", "radar/points", _before_1970),
    Fault("tracks of a status that there is not", MEANS, "99 is not a valid TrackStatus", watched(_paired(_track(status=99))), 8),
    Fault("tracks whose lists have unequal lengths", MEANS, r"zip\(\) argument", watched(_paired(_set(deleted_id=[1, 2]))), 8),
    Fault(
        "tracks of other points than the cloud's",
        MEANS,
        "point_track_id has shape",
        watched(_paired(_set(point_track_id=array.array("i", [0] * 9999)))),
        8,
    ),
    Fault("tracks at places that are no numbers", MEANS, "finite", watched(_paired(_track(position=np.full(3, math.nan)))), 8),
    Fault(
        "tracks deleted for a reason that there is not",
        MEANS,
        "99 is not a valid Reason",
        watched(_paired(_set(deleted_id=[1], deleted_reason=[99], deleted_confirmed=[True]))),
        8,
    ),
    _refused("sequence of frames at its last number", "messages are missing before", "radar/frame", _set(sequence=_LAST), most=8),
    _refused("sequence of clouds at its last number", "messages are missing before", "radar/points", _set(sequence=_LAST), most=8),
    _refused("sequence of tracks at its last number", "messages are missing before", "tracks", _set(sequence=_LAST), most=8),
    _refused("a radar of 65,536 x 8,192 samples", "larger than any radar|makes no sense", "radar/info", _set(n_chirp=65536, n_sample=8192)),
    _refused("a radar of 2,000 receivers", "larger than any radar", "radar/info", _many_receivers),
    _refused("a radar whose numbers are none", "finite", "radar/info", _set(carrier_hz=math.nan)),
    _refused("another radar on the same topics", "radar/info changed while running", "radar/info", lambda msg, _: copy.deepcopy(_OTHER)),
    _refused(
        "a frame of another shape", "its radar info says|carries", "radar/frame", lambda msg, _: setattr(msg, "n_chirp", msg.n_chirp + 1)
    ),
    _refused("a frame with samples that are no numbers", "non-finite", "radar/frame", _spoilt("data", math.nan)),
    _refused("a frame that lost chirps that it has not", "names chirps", "radar/frame", _set(missing_chirps=[4_000_000_000])),
    _refused("texts of which no two are alike", "says .*carries|n_chirp", "radar/frame", _random_names),
    _refused("clouds whose arrays have unequal lengths", "shape|length", "radar/points", _set(x=[1.0, 2.0, 3.0])),
    _refused("clouds with infinite places", "infinite places", "radar/points", _infinite),
    Fault("clouds of 70,000 points", MEANS, "more than a radar gives", watched(_large_clouds)),
    # Nodes tell the same again after five seconds: faults that give the same text stand apart.
    _refused("a frame that is cut short", "but carries", "radar/frame", _cut_short),
    _refused("zones of a kind that there is not", "is of kind 77", "zones", _zone(kind=77)),
    _refused("zones whose corners are no numbers", "finite|corner|polygon", "zones", _zone(polygon=[math.nan] * 6)),
    Fault(
        "bytes that are no cloud",
        MEANS,
        "a message cannot be read: .*PointCloud",
        watched(_bytes("radar/points", b"\0\1\0\0" + bytes(range(40)))),
    ),
    Fault(
        "bytes that are no tracks", MEANS, "a message cannot be read: .*TrackArray", watched(_bytes("tracks", b"\0\1\0\0\xff\xff\xff\x7f"))
    ),
    Fault(
        "bytes that describe no radar",
        MEANS,
        "a message cannot be read: .*RadarInfo",
        watched(_bytes("radar/info", b"\0\1\0\0" + bytes(range(12)))),
    ),
    Fault(
        "a hand of nobody",
        "real service",
        "there is no track",
        watched(_called("hand/track", TrackHand, _HAND, lambda response: response.message)),
    ),
    Fault(
        "a parameter of another type",
        "real service",
        "should be a valid number",
        watched(_parameter("tracking", "association.gate", "wide")),
    ),
    Fault(
        "a parameter out of its range", "real service", "between|range|at least", watched(_parameter("tracking", "association.gate", -5.0))
    ),
)
