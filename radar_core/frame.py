"""Raw frames and what is needed to understand them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core.antenna import AntennaArray
from radar_core.checks import require_finite, require_shape
from radar_core.config import config, knob
from radar_core.errors import ConfigError, DataError
from radar_core.geometry import Pose
from radar_core.waveform import Waveform

MOST_CHANNELS: Final = 1024
"""Virtual channels of a radar; imaging radars of several chips have some hundreds."""
MOST_SAMPLES: Final = 1 << 25
"""Complex samples of a frame, 256 MiB: memory and time are set aside for what a radar says of itself."""


@config
class RadarInfo:
    """What a radar is and where it stands: everything that does not change from frame to frame."""

    frame_id: str = knob("radar", doc="name of the sensor frame, e.g. left/radar")
    waveform: Waveform = Waveform()
    array: AntennaArray = AntennaArray()
    mount: Pose = Pose()
    full_scale: float = knob(
        0.0, low=0.0, high=1e30, doc="largest real or imaginary part that the converter can give, in the unit of the frames; 0: unknown"
    )

    def validate(self) -> None:
        """Raise `ConfigError` when waveform and array disagree on the number of transmitters, or frames are larger than any radar's."""
        if self.waveform.n_tx != self.array.n_tx:
            raise ConfigError(
                f"the waveform uses {self.waveform.n_tx} transmitters but the array has {self.array.n_tx}; make waveform.n_tx equal "
                "to the number of entries of array.tx"
            )
        channels = self.array.n_tx * self.array.n_rx
        if channels > MOST_CHANNELS or math.prod(self.cube_shape) > MOST_SAMPLES:
            raise ConfigError(
                f"a frame of {self.cube_shape} (tx, chirp, rx, sample) is larger than any radar's: at most {MOST_CHANNELS} virtual "
                f"channels and {MOST_SAMPLES} samples; whatever describes the radar is broken"
            )

    @property
    def cube_shape(self) -> tuple[int, int, int, int]:
        """Shape of this radar's frames, axes (tx, chirp, rx, sample)."""
        return (self.waveform.n_tx, self.waveform.n_chirp, self.array.n_rx, self.waveform.n_sample)


@dataclass(frozen=True, eq=False)
class RadarFrame:
    """One measurement frame of raw baseband data.

    The phase of a target at delay tau is +2 pi (f_min tau + slope tau t): range beats are positive frequencies in fast time, and a
    receding target turns forward in slow time. Drivers of boards with the other sign conjugate.

    Attributes
    ----------
    cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
        Chirp ``l`` of transmitter ``t`` starts ``(l * n_tx + t) * chirp_interval`` after the stamp.
    stamp_ns : int
        Start of the acquisition in the driver's clock [ns].
    sequence : int
        Counts the frames the radar made; a gap is a lost frame.
    frame_id : str
        Name of the sensor frame.
    missing : ndarray of uint32, shape (n_missing,)
        Numbers ``l * n_tx + t`` of chirps that the device lost, ascending; their samples are to be ignored.
    """

    cube: NDArray[np.complex64]
    stamp_ns: int
    sequence: int
    frame_id: str
    missing: NDArray[np.uint32] = field(default_factory=lambda: np.empty(0, np.uint32))

    def __post_init__(self) -> None:
        require_shape("RadarFrame.cube", self.cube, (None, None, None, None))
        if self.cube.dtype != np.complex64:
            raise DataError(f"RadarFrame.cube is {self.cube.dtype}, expected complex64")
        require_shape("RadarFrame.missing", self.missing, (None,))
        n = self.cube.shape[0] * self.cube.shape[1]
        if len(self.missing) and (int(self.missing[-1]) >= n or np.any(self.missing[1:] <= self.missing[:-1])):
            raise DataError(f"RadarFrame.missing names chirps {self.missing.tolist()[:8]}; they have to ascend and be below {n}")

    def check(self, info: RadarInfo) -> None:
        """Raise `DataError` when the cube contradicts ``info`` in its shape or holds a non-finite sample."""
        if self.cube.shape != info.cube_shape:
            raise DataError(
                f"frame {self.sequence} of {self.frame_id!r} has shape {self.cube.shape} (tx, chirp, rx, sample) but its radar info says "
                f"{info.cube_shape}; the info belongs to another radar or setting: configure the driver again, or replay the whole bag"
            )
        require_finite("RadarFrame.cube", self.cube)
