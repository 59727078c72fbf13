"""Command about cameras: where one stands to the radar."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from radar_core import ConfigError, DataError

if TYPE_CHECKING:
    from radar_lab.alignment import Trajectory
    from radar_lab.camera.extrinsics import CameraCalibration

_BODY = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


def calibrate_camera(
    bag: Annotated[Path, typer.Argument(help="recording with camera/joints and hand (or tracks)")],
    out: Annotated[Path, typer.Option("--out", "-o", help="file for the result (.yaml), for: handwave up camera --config camera=FILE")],
    config: Annotated[Path | None, typer.Option("--config", "-c", help="YAML that the camera node had while it was recorded")] = None,
    what: Annotated[str, typer.Option("--with", help="what both saw: hand; or body, from above, which leaves height and tilt")] = "hand",
    joint: Annotated[str, typer.Option(help="hand: the camera's joint")] = "right_hand",
    freedom: Annotated[str, typer.Option(help="yaw: tilt and roll stay as they are; full: all angles")] = "yaw",
    synchronised: Annotated[bool, typer.Option("--synchronised", help="the latency is known; do not look for it")] = False,
) -> None:
    """Find where the camera stands in the radar's room, and its latency, from a hand or a body that both saw move.

    Record a running `handwave up live` beside `handwave up camera`. Move through the room for a minute, in several directions and at
    changing speed, while the hand (or the person) is followed.

    Examples: `handwave calibrate-camera walk -o camera.yaml` · `handwave calibrate-camera walk --with body -o camera.yaml`
    """
    import yaml

    from radar_core.config import load
    from radar_core.files import write_whole
    from radar_lab.alignment import TrajectoryConfig
    from radar_lab.camera.extrinsics import calibrate
    from radar_lab.camera.pinhole import CameraMount

    if what not in ("hand", "body"):
        raise ConfigError(f"--with {what!r}: choose hand or body")
    before = _read(config)
    assumed = CameraMount(**before.get("mount", {}))
    radar, camera = trajectories(bag, what, joint)
    latency = float(before.get("latency", 0.0))
    found = calibrate(radar, camera, assumed, latency, load(TrajectoryConfig, {"freedom": freedom, "clock": not synchronised}, "options"))
    mount = {name: round(getattr(found.mount, name), 5) for name in ("x", "y", "z", "yaw", "tilt", "roll")}
    after = {**before, "mount": mount, "position_std": round(found.position_std, 5), "angle_std": round(found.angle_std, 6)}
    if not math.isnan(found.latency_std):
        after |= {"latency": round(found.latency, 5), "latency_std": round(found.latency_std, 6)}
    try:
        write_whole(out, yaml.safe_dump(after, sort_keys=False))
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written ({error.strerror or error}); name a file in a folder that exists") from None
    print("\n".join(lines(found)))
    print(f"configuration of the camera node in {out}")


def lines(found: CameraCalibration) -> list[str]:
    """Say what was found, for people."""
    m, a = found.mount, found.alignment
    late = "latency as given" if math.isnan(found.latency_std) else f"latency {found.latency * 1e3:.1f} +- {found.latency_std * 1e3:.1f} ms"
    return [
        f"camera at x {m.x:.3f}, y {m.y:.3f}, z {m.z:.3f} m (+- {found.position_std:.3f}), {late}",
        f"yaw {m.yaw:.4f}, tilt {m.tilt:.4f}, roll {m.roll:.4f} rad (+- {found.angle_std:.4f})",
        f"{a.pairs} pairs, {a.n_effective:.0f} independent, {a.inlier_share:.0%} fit; {a.rms:.3f} m rms apart after alignment",
    ]


def _read(config: Path | None) -> dict[str, Any]:
    """Read what the camera node was told; empty: its defaults."""
    from radar_core.config import load_file
    from radar_core.yaml_text import read_yaml
    from radar_lab.camera.truth import CameraTruthConfig

    if config is None:
        return {}
    load_file(CameraTruthConfig, config)  # for its messages
    return dict(read_yaml(config.read_text(encoding="utf-8"), config) or {})


def trajectories(bag: Path, what: str, joint: str) -> tuple[Trajectory, Trajectory]:
    """Read what radar and camera saw in a recording, both in ``room``: of a ``hand`` (``joint`` of the camera), or of a ``body``.

    A body is on the floor plane. A `DataError` says that the recording lacks a topic, or holds nothing of the hand or the body.
    """
    from radar_ros.bags import require_topics

    topic = "hand" if what == "hand" else "tracks"
    require_topics(bag, ("camera/joints", topic))
    return _radar(bag, topic), _camera(bag, (joint,) if what == "hand" else _BODY, 3 if what == "hand" else 2)


def _radar(bag: Path, topic: str) -> Trajectory:
    """Read the hand, or the person who was confirmed for longest, on the floor plane."""
    from radar_ros.bags import read
    from radar_ros.messages.tracks import hand_from_msg, tracks_from_msg
    from radar_ros.offline import parse
    from radar_tracking import TrackStatus

    found: dict[int, list[tuple[int, Any, Any, Any]]] = {}
    for item in read(bag, (topic,)):
        msg = parse(item.data, topic)
        if topic == "hand":
            hand = hand_from_msg(msg)
            if hand.active and hand.unseen == 0.0:
                found.setdefault(0, []).append((hand.stamp_ns, hand.position, hand.covariance[:3, :3], hand.velocity))
            continue
        tracks = tracks_from_msg(msg)
        for track in tracks.tracks:
            if track.status is TrackStatus.CONFIRMED:
                row = (tracks.stamp_ns, track.position[:2], track.covariance[:2, :2], track.velocity[:2])
                found.setdefault(track.id, []).append(row)
    if not found:
        raise DataError(f"{bag}: nothing in {topic} was ever seen; record while the {'hand' if topic == 'hand' else 'person'} is followed")
    return _trajectory(max(found.values(), key=len))


def _camera(bag: Path, names: tuple[str, ...], d: int) -> Trajectory:
    """Read the mean of some joints, where all of those that the camera looks for were seen."""
    from radar_ros.bags import read
    from radar_ros.messages.camera import joints_from_msg
    from radar_ros.offline import parse

    found = []
    known: tuple[str, ...] = ()
    for item in read(bag, ("camera/joints",)):
        joints = joints_from_msg(parse(item.data, "camera/joints"))
        known = joints.names
        rows = [i for i, name in enumerate(known) if name in names]
        place = joints.position[rows].mean(0) if rows else joints.position[:0]
        if rows and all(map(math.isfinite, place)):
            covariance = joints.covariance[rows].mean(0) - joints.common[rows].mean(0)
            found.append((joints.stamp_ns, place[:d], covariance[:d, :d], joints.velocity[rows].mean(0)[:d]))
    if not found:
        raise DataError(f"{bag}: the camera never saw {' and '.join(names)}; its joints are {', '.join(known) or 'none'}")
    return _trajectory(found)


def _trajectory(rows: list[tuple[int, Any, Any, Any]]) -> Trajectory:
    """Put rows of stamp, place, covariance and velocity together, each stamp once, in order."""
    import numpy as np

    from radar_lab.alignment import Trajectory

    once = sorted({row[0]: row for row in rows}.values(), key=lambda row: row[0])
    stamp, place, covariance, velocity = zip(*once, strict=True)
    return Trajectory(np.array(stamp, np.int64), np.stack(place), np.stack(covariance), np.stack(velocity))
