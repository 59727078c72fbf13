"""A measured mount: where a radar stands, and how sure that is; the file that calibration writes and drivers read."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from radar_core.config import config, knob, load_file, plain
from radar_core.errors import ConfigError
from radar_core.files import write_whole
from radar_core.frame import RadarInfo
from radar_core.geometry import Pose

Float64Array = NDArray[np.float64]
Row = tuple[float, float, float]

_NOTHING: tuple[Row, Row, Row] = ((0.0, 0.0, 0.0),) * 3
_VERSION = 1


@config
class MountCalibration:
    """Where one radar stands in ``room``: measured beside another one whose mount is taken as it is, or how far it is tilted."""

    version: int = knob(_VERSION, low=_VERSION, high=_VERSION, doc="of this kind of file")
    radar: str = knob(doc="frame of the radar, e.g. right/radar")
    reference: str = knob("", doc="frame of the radar beside which it was measured")
    mount: Pose = knob(doc="where it stands; what was not measured is as it was given")
    covariance: tuple[Row, Row, Row] = knob(_NOTHING, doc="of x, y and yaw of the mount [m, m, rad]")
    tilt_std: float = knob(0.0, unit="rad", low=0.0, high=math.pi, doc="standard deviation of the tilt; 0: taken as it was given")
    clock_offset: float = knob(0.0, unit="s", low=-60.0, high=60.0, doc="to be added to its stamps to get the reference's time")
    clock_offset_std: float = knob(0.0, unit="s", low=0.0, high=60.0, doc="standard deviation of the same; 0: not measured")

    def validate(self) -> None:
        """Raise `ConfigError` when the radar has no name, or the covariance is none."""
        if not self.radar:
            raise ConfigError("MountCalibration.radar is empty; name the radar's frame, e.g. right/radar")
        matrix = np.array(self.covariance)
        size = float(np.abs(matrix).max())
        if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-9 * size) or np.linalg.eigvalsh(matrix)[0] < -1e-6 * size:
            raise ConfigError("MountCalibration.covariance must be symmetric and without negative eigenvalues")

    def names(self, frame_id: str) -> bool:
        """Whether it is about the radar with this frame, e.g. ``right/radar``."""
        return self.radar.strip("/") == frame_id.strip("/")

    def applied(self, info: RadarInfo) -> RadarInfo:
        """Put the measured mount into a radar's description; that of another radar stays as it is."""
        return dataclasses.replace(info, mount=self.mount) if self.names(info.frame_id) else info

    @property
    def pose_covariance(self) -> Float64Array:
        """Covariance of x, y, z and turns about x, y, z, shape (6, 6), as geometry_msgs has it; 0: taken as given."""
        result = np.zeros((6, 6))
        index = np.array([0, 1, 5])
        result[np.ix_(index, index)] = self.covariance
        result[4, 4] = self.tilt_std**2
        return result

    def _written(self) -> dict[str, Any]:
        """Say everything, so that nobody has to know defaults to read the file."""
        mount = {name: getattr(self.mount, name) for name in ("x", "y", "z", "yaw", "tilt")}
        return {"version": self.version, **plain(self), "mount": mount, "covariance": plain(self.covariance)}

    def save(self, path: str | Path) -> None:
        """Write a YAML file.

        Raises
        ------
        ConfigError
            When it cannot be written.
        """
        x, y, yaw = np.sqrt(np.maximum(np.diagonal(np.array(self.covariance)), 0.0)).tolist()
        where = f"beside {self.reference}: handwave calibrate-pair" if self.reference else "tilt measured: handwave calibrate-tilt"
        head = (
            f"# Where {self.radar} stands in the room, {where} (docs/how-to/calibration.md)\n"
            f"# standard deviations: x {x * 1e3:.1f} mm, y {y * 1e3:.1f} mm, yaw {math.degrees(yaw):.3f} degrees, "
            f"tilt {math.degrees(self.tilt_std):.2f} degrees; 0: as it was given\n"
        )
        try:
            write_whole(path, head + yaml.safe_dump(self._written(), sort_keys=False))
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written ({error.strerror or error}); choose another place with --out") from None


def load_mount(path: str | Path) -> MountCalibration:
    """Read a file that calibration wrote.

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """
    return load_file(MountCalibration, path)
