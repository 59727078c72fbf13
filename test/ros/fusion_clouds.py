"""Two radars, and what they measure of a few points."""

import numpy as np

from radar_core import PointCloud, Pose, RadarInfo
from radar_core.geometry import cartesian_to_spherical, spherical_to_cartesian

MS = 1_000_000
START = 100 * 10**9
MOUNTS = {"left": Pose(y=0.8, yaw=-0.3), "right": Pose(y=-0.8, yaw=0.3)}


def info(name, **changes):
    return RadarInfo(**{"frame_id": f"{name}/radar", "mount": MOUNTS[name], **changes})


def cloud(name, ms, sequence=0, body=(2.5, 0.2, 1.1), n=6, velocity=None):
    """What a radar measures of a few points about a body, ``ms`` after the start; ``velocity`` [m/s] in the room gives range rates."""
    local = MOUNTS[name].from_room(np.asarray(body) + np.random.default_rng(sequence).normal(0, 0.1, (n, 3)))
    distance, azimuth, elevation = cartesian_to_spherical(local)
    xyz = spherical_to_cartesian(distance, azimuth, elevation)
    values = {"x": xyz[:, 0], "y": xyz[:, 1], "z": xyz[:, 2], "range": distance, "azimuth": azimuth, "elevation": elevation}
    rate = np.full(n, 0.4) if velocity is None else local @ (MOUNTS[name].rotation.T @ np.asarray(velocity)) / distance
    values |= {"radial_speed": rate, "snr": np.full(n, 20.0)}
    arrays = {key: value.astype(np.float32) for key, value in values.items()}
    return PointCloud(START + round(ms * MS), sequence, f"{name}/radar", **arrays)
