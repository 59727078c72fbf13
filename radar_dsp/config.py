"""Configuration of the baseband chain: one nested dataclass per step."""

from __future__ import annotations

from typing import Literal

from radar_core.config import config, knob
from radar_core.errors import ConfigError
from radar_dsp.windows import make_window

FftName = Literal["scipy", "numpy", "fftw", "fixed"]
CfarAlgorithm = Literal["os", "ca", "go", "so"]
CfarWindow = Literal["2d", "range", "speed"]
Missing = Literal["autoregressive", "cubic", "zero"]
Grouping = Literal["none", "range", "peak"]
DoaMode = Literal["auto", "azimuth_elevation", "azimuth", "elevation", "void"]
Backend = Literal["numba", "numpy"]


@config
class SpectrumConfig:
    """Windows of the two Fourier transforms, by scipy's names; a parameter follows a colon, e.g. ``chebwin:60`` or ``kaiser:8.6``."""

    range_window: str = knob("nuttall", doc="window over the samples of a chirp (scipy name[:parameter]); low side lobes: less coupling")
    speed_window: str = knob("hann", doc="window over the chirps of a frame (scipy name[:parameter])")
    fft: FftName = knob("scipy", doc="who transforms; fftw needs pyfftw; fixed: integers, as in an FPGA")
    word_length: int = knob(16, unit="bit", low=8, high=16, doc="fixed only: length of the real and the imaginary word")
    static: Literal["keep", "remove"] = knob("keep", doc="remove: take out the mean over the chirps: all that stands still, people too")
    missing: Missing = knob(
        "autoregressive",
        doc="chirps that the device lost; autoregressive: predicted from both sides, range cell by range cell; cubic: polynomial through "
        "the next ones, for slow echoes only; zero: left zero, which spreads strong echoes over all speeds",
    )

    def validate(self) -> None:
        """Raise `ConfigError` when scipy does not know a window."""
        for name in (self.range_window, self.speed_window):
            make_window(name, 16)


@config
class CouplingConfig:
    """The region near zero range and zero speed where transmitters couple into receivers (thesis, figure 2.5).

    It has at least as many cells as the main lobes of the windows; ``handwave calibrate-coupling`` measures how many more it takes.
    """

    range_extent: float = knob(
        0.25, unit="m", low=0.0, high=1e4, doc="suppress ranges below this, and at least the window's main lobe; 0 keeps everything"
    )
    speed_extent: float = knob(
        0.2, unit="m/s", low=0.0, high=1e3, doc="suppress there only speeds of a magnitude up to this, and at least the window's main lobe"
    )


@config
class CfarConfig:
    """Constant-false-alarm detection (thesis, figure A.12): an algorithm and a window, chosen apart."""

    algorithm: CfarAlgorithm = knob(
        "os", doc="os: ordered statistic, sturdy beside other echoes; ca: cell average; go, so: greater or smaller average of both sides"
    )
    window: CfarWindow = knob("2d", doc="training cells around the cell, or only along one axis")
    false_alarm: float = knob(1e-4, low=1e-12, high=0.1, doc="wanted probability of a false alarm per cell on noise")
    guard_range: int = knob(2, low=0, high=32, doc="cells left out on each side of the cell under test, in range")
    guard_speed: int = knob(1, low=0, high=32, doc="cells left out on each side of the cell under test, in speed")
    training_range: int = knob(4, low=0, high=32, doc="training cells beyond the guard on each side, in range")
    training_speed: int = knob(2, low=0, high=32, doc="training cells beyond the guard on each side, in speed")
    rank: float = knob(
        0.5, low=0.05, high=0.95, doc="os only: order statistic over number of training cells; high ranks let a body hide its own limbs"
    )

    def validate(self) -> None:
        """Raise `ConfigError` when the window has no training cell."""
        used = {"2d": self.training_range + self.training_speed, "range": self.training_range, "speed": self.training_speed}[self.window]
        if used == 0:
            names = {"2d": "training_range and training_speed are both", "range": "training_range is", "speed": "training_speed is"}
            raise ConfigError(f"CfarConfig.{names[self.window]} 0; window {self.window!r} needs training cells")


@config
class TdmConfig:
    """What transmitters taking turns does to moving echoes (thesis, figure A.17)."""

    compensate: Literal["tdm", "none"] = knob("tdm", doc="tdm: take out the phase by which echoes turn between two transmitters' turns")
    unfold: bool = knob(False, doc="find the range rate beyond the unambiguous one by which of its hypotheses the array's phases fit best")


@config
class DoaConfig:
    """Direction of arrival from the phases between the virtual channels (thesis, 2.3, 2.16 and figure A.15)."""

    mode: DoaMode = knob(
        "auto",
        doc="auto: whatever the array can measure; azimuth: elevation is NaN and points lie at the sensor's height; "
        "elevation: azimuth is NaN, and x, y, z with it; void: x, y, z are NaN",
    )
    method: Literal["dml", "dml2", "capon"] = knob(
        "dml", doc="dml: deterministic maximum likelihood; dml2: two echoes in one cell where they fit better; capon: minimum variance"
    )
    search: Literal["newton", "grid"] = knob("newton", doc="newton: coarse grid, then refinement; grid: the best point of the grid")
    grid_azimuth: int = knob(17, low=2, high=721, doc="points of the coarse search over azimuth")
    grid_elevation: int = knob(5, low=2, high=361, doc="points of the coarse search over elevation")
    newton_steps: int = knob(2, low=0, high=20, doc="refinement steps after the coarse search")
    loading: float = knob(0.05, low=1e-6, high=10.0, doc="capon only: diagonal loading, relative to the mean power of a channel")
    split: float = knob(1e-3, low=1e-12, high=0.5, doc="dml2 only: probability of taking one echo in noise for two")
    gate: bool = knob(True, doc="drop detections whose direction the array does not tell and that are outside its field of view")


@config
class BasebandConfig:
    """Everything between a raw frame and its point cloud."""

    spectrum: SpectrumConfig = SpectrumConfig()
    coupling: CouplingConfig = CouplingConfig()
    cfar: CfarConfig = CfarConfig()
    tdm: TdmConfig = TdmConfig()
    doa: DoaConfig = DoaConfig()
    grouping: Grouping = knob(
        "range", doc="which cells above the threshold become points: none: all; range: maxima along range; peak: maxima on both axes"
    )
    select: Literal["all", "doppler"] = knob(
        "all", doc="doppler: of every Doppler bin only the strongest cell over range becomes a point (thesis, 4.2); for one person in view"
    )
    refine: Literal["none", "ml"] = knob("none", doc="ml: joint maximum likelihood of range, speed and direction on the samples; slow")
    max_detections: int = knob(512, low=1, high=1 << 20, doc="keep at most this many of the strongest cells of a frame")
    min_snr: float = knob(-100.0, unit="dB", low=-100.0, high=200.0, doc="drop points below this signal-to-noise ratio; -100 keeps all")
    backend: Backend = knob("numba", doc="who finds the directions: compiled loops, or numpy; both give the same points")
