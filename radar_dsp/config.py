"""Configuration of the baseband chain: one nested dataclass per step."""

from __future__ import annotations

from radar_core.config import config, knob
from radar_core.errors import ConfigError
from radar_dsp.windows import make_window

GROUPINGS = ("none", "range", "peak")
DOA_MODES = ("auto", "azimuth_elevation", "azimuth", "void")


@config
class SpectrumConfig:
    """Windows of the two Fourier transforms, by scipy's names; a parameter follows a colon, e.g. ``chebwin:60`` or ``kaiser:8.6``."""

    range_window: str = knob(
        "nuttall", doc="window over the samples of a chirp (scipy name, parameters after colons); low side lobes keep the coupling down"
    )
    speed_window: str = knob("hann", doc="window over the chirps of a frame (scipy name, parameters after colons)")

    def validate(self) -> None:
        """Raise `ConfigError` when scipy does not know a window."""
        for name in (self.range_window, self.speed_window):
            make_window(name, 16)


@config
class CouplingConfig:
    """The region near zero range and zero speed where transmitters couple into receivers (thesis, figure 2.5)."""

    range_extent: float = knob(0.25, unit="m", low=0.0, high=1e4, doc="suppress ranges below this; 0 keeps everything")
    speed_extent: float = knob(0.2, unit="m/s", low=0.0, high=1e3, doc="suppress there only speeds of a magnitude up to this")


@config
class CfarConfig:
    """Constant-false-alarm detection with a two-dimensional window."""

    algorithm: str = knob("os", choices=("os", "ca"), doc="os: ordered statistic, sturdy beside other echoes; ca: cell average")
    false_alarm: float = knob(1e-4, low=1e-12, high=0.1, doc="wanted probability of a false alarm per cell on noise")
    guard_range: int = knob(2, low=0, high=32, doc="cells left out on each side of the cell under test, in range")
    guard_speed: int = knob(1, low=0, high=32, doc="cells left out on each side of the cell under test, in speed")
    training_range: int = knob(4, low=0, high=32, doc="training cells beyond the guard on each side, in range")
    training_speed: int = knob(2, low=0, high=32, doc="training cells beyond the guard on each side, in speed")
    rank: float = knob(
        0.5,
        low=0.05,
        high=0.95,
        doc="os only: order statistic over number of training cells; high ranks let a body hide its own limbs",
    )

    def validate(self) -> None:
        """Raise `ConfigError` when the window has no training cell."""
        if self.training_range == 0 and self.training_speed == 0:
            raise ConfigError("CfarConfig.training_range and training_speed are both 0; at least one must give training cells")


@config
class DoaConfig:
    """Direction of arrival by deterministic maximum likelihood (2.16)."""

    mode: str = knob(
        "auto",
        choices=DOA_MODES,
        doc="auto: whatever the array can measure; azimuth: elevation is NaN and points lie at the sensor's height; void: x, y, z are NaN",
    )
    grid_azimuth: int = knob(17, low=2, high=721, doc="points of the coarse search over azimuth")
    grid_elevation: int = knob(5, low=2, high=361, doc="points of the coarse search over elevation")
    newton_steps: int = knob(2, low=0, high=20, doc="refinement steps after the coarse search")
    gate: bool = knob(True, doc="drop detections outside the array's field of view")


@config
class BasebandConfig:
    """Everything between a raw frame and its point cloud."""

    spectrum: SpectrumConfig = SpectrumConfig()
    coupling: CouplingConfig = CouplingConfig()
    cfar: CfarConfig = CfarConfig()
    doa: DoaConfig = DoaConfig()
    grouping: str = knob(
        "range",
        choices=GROUPINGS,
        doc="which cells above the threshold become points: none: all; range: maxima along range at every speed; peak: maxima on both axes",
    )
    max_detections: int = knob(512, low=1, high=1 << 20, doc="keep at most this many of the strongest cells of a frame")
    min_snr: float = knob(-100.0, unit="dB", low=-100.0, high=200.0, doc="drop points below this signal-to-noise ratio; -100 keeps all")
