"""Effects that a scene can name: the vocabulary of ``effects:``. One that is not named costs nothing and changes nothing."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from radar_core import ConfigError
from radar_core.config import config, knob


@config
class OcclusionConfig:
    """Bodies, walls and furniture hide what is behind them, people their own far parts too."""

    resolution: float = knob(0.005, unit="rad", low=1e-3, high=0.1, doc="cells by which triangles are sorted; changes the time only")


@config
class MultipathConfig:
    """Echoes by way of floor and walls: there mirrored, back mirrored, or both (image sources, first order)."""

    floor: float = knob(0.15, low=0.0, high=1.0, doc="share of the power that the floor mirrors; 0: none")
    walls: bool = knob(True, doc="the scene's walls mirror too, each by its own share")
    level: float = knob(-60.0, unit="dB", low=-200.0, high=0.0, doc="paths weaker than this against the straight one are left out")


@config
class ClutterConfig:
    """Small still scatterers all over the room, drawn from the seed."""

    count: int = knob(200, low=1, high=100_000, doc="how many")
    rcs: float = knob(1e-3, unit="m^2", low=0.0, high=1e3, doc="mean radar cross-section of one; exponentially distributed")
    low: tuple[float, float, float] = knob((0.5, -4.0, 0.0), unit="m", low=-100.0, high=100.0, doc="one corner of the volume in the room")
    high: tuple[float, float, float] = knob((8.0, 4.0, 2.5), unit="m", low=-100.0, high=100.0, doc="the opposite corner")

    def validate(self) -> None:
        """Raise `ConfigError` when the corners are not in order."""
        if any(a >= b for a, b in zip(self.low, self.high, strict=True)):
            raise ConfigError(f"ClutterConfig: low {self.low} is not below high {self.high} along every axis; exchange them")


@config
class SwerlingConfig:
    """Cross-sections that fluctuate (Swerling 1954): of points, of people as a whole, or of both."""

    case: int = knob(
        1, low=0, high=4, doc="0: steady; 1, 2: chi-square with 2 degrees of freedom; 3, 4: with 4; 1, 3: new each frame, 2, 4: each chirp"
    )
    of: Literal["points", "people", "all"] = knob("points", doc="what fluctuates")


@config
class PatternConfig:
    """Element pattern: gain over direction, for the way out and the way back."""

    edge: float = knob(
        -3.0, unit="dB", low=-60.0, high=0.0, doc="one-way gain at half the field of view relative to the boresight, in each plane"
    )
    azimuth: tuple[float, ...] = knob((), unit="deg", low=-180.0, high=180.0, doc="of a measured pattern, ascending; empty: edge")
    elevation: tuple[float, ...] = knob((), unit="deg", low=-90.0, high=90.0, doc="of a measured pattern, ascending")
    gain: tuple[tuple[float, ...], ...] = knob(
        (),
        unit="dB",
        low=-200.0,
        high=60.0,
        doc="one-way gain relative to the boresight: one row per azimuth, one column per elevation",
    )

    def validate(self) -> None:
        """Raise `ConfigError` when a measured pattern's matrix does not fit its directions."""
        sizes = {len(row) for row in self.gain} or {0}
        if len(self.gain) != len(self.azimuth) or sizes != {len(self.elevation)}:
            raise ConfigError(
                f"PatternConfig.gain has {len(self.gain)} rows of {sorted(sizes)} entries for {len(self.azimuth)} azimuths and "
                f"{len(self.elevation)} elevations; give one row per azimuth with one entry per elevation"
            )
        if self.azimuth and not self.elevation:
            raise ConfigError("PatternConfig.elevation is empty, but azimuth and gain are given; give the elevations of gain's columns")
        for name in ("azimuth", "elevation"):
            values = getattr(self, name)
            if any(b <= a for a, b in pairwise(values)):
                raise ConfigError(f"PatternConfig.{name} has to ascend; sort it, with the rows and columns of gain")


@config
class FieldOfViewConfig:
    """Nothing comes back from beyond the array's field of view."""

    margin: float = knob(0.0, unit="rad", low=-1.0, high=1.0, doc="widen (or narrow) the field of view by this on each side")


@config
class LossesConfig:
    """What a board loses against the radar equation, in one figure: radome, feed lines, polarisation, clothing, converter."""

    level: float = knob(
        20.0, unit="dB", low=0.0, high=100.0, doc="echoes are that much weaker than the radar equation says, both ways together"
    )


@config
class HighPassConfig:
    """High-pass filter of the intermediate frequency: it holds down coupling and near echoes, and turns their phase."""

    corner: float = knob(100e3, unit="Hz", low=1.0, high=1e9, doc="frequency at which the gain has fallen by 3 dB")
    order: int = knob(1, low=1, high=8, doc="of the Butterworth filter: 20 dB per decade and order")


@config
class ChannelErrorsConfig:
    """What makes the channels of a real array differ from its drawing; drawn from the seed."""

    gain: float = knob(1.0, unit="dB", low=0.0, high=30.0, doc="rms gain error of a virtual channel")
    phase: float = knob(math.radians(15.0), unit="rad", low=0.0, high=math.pi, doc="rms phase error of a virtual channel")
    shift: float = knob(1e-4, unit="m", low=0.0, high=0.1, doc="rms position error of a transmitter or receiver, along y and along z")
    seed: int = knob(0, low=0, high=1 << 62, doc="of the errors; the scene's own seed does not change them")


@config
class CouplingConfig:
    """Leakage from every transmitter into every receiver: a strong echo near zero range that stands still."""

    level: float = knob(-60.0, unit="dB", low=-300.0, high=0.0, doc="leaked over transmitted power")
    distance: float = knob(0.03, unit="m", low=0.0, high=10.0, doc="range at which the leakage appears")


@config
class InterferenceConfig:
    """Another FMCW radar that transmits into the receivers; where its chirps cross ours, they leave a burst."""

    position: tuple[float, float, float] = knob((5.0, 2.0, 1.2), unit="m", low=-1e4, high=1e4, doc="(x, y, z) in the room")
    power: float = knob(22.0, unit="dBm", low=-200.0, high=100.0, doc="radiated towards us (EIRP)")
    carrier: float = knob(76.75e9, unit="Hz", low=1e9, high=1e12, doc="centre of its sweep")
    bandwidth: float = knob(1.0e9, unit="Hz", low=0.0, high=1e11, doc="of its sweep")
    duration: float = knob(40e-6, unit="s", low=1e-7, high=1.0, doc="of its sweep")
    pause: float = knob(13e-6, unit="s", low=0.0, high=1.0, doc="between its sweeps")
    drift: float = knob(20e-6, low=-1e-2, high=1e-2, doc="its clock runs faster by this share")


@config
class NoiseConfig:
    """Thermal noise of the receivers, k T F B, and the gain of their amplifier."""

    noise_figure: float = knob(12.0, unit="dB", low=0.0, high=60.0, doc="noise figure of the receiver")
    temperature: float = knob(290.0, unit="K", low=0.0, high=1e4, doc="reference temperature")
    gain: float = knob(0.0, unit="dB", low=-50.0, high=150.0, doc="gain from the antenna to the converter (LNA, mixer, filter)")


@config
class PhaseNoiseConfig:
    """Phase noise of the oscillator, which mixes with its own delayed self: what is near keeps little of it (range correlation)."""

    level: float = knob(-90.0, unit="dBc/Hz", low=-250.0, high=0.0, doc="single-sideband level at `offset`")
    offset: float = knob(1e6, unit="Hz", low=1.0, high=1e9, doc="offset from the carrier of that level; it falls by 20 dB per decade")
    corner: float = knob(1e5, unit="Hz", low=0.0, high=1e9, doc="below this offset the level stays (loop bandwidth)")
    floor: float = knob(-130.0, unit="dBc/Hz", low=-300.0, high=0.0, doc="level that it never falls below")


@config
class IqImbalanceConfig:
    """Gain and phase by which the quadrature arm of the mixer differs: a mirror image at the opposite beat frequency, and an offset."""

    gain: float = knob(0.5, unit="dB", low=-20.0, high=20.0, doc="gain of Q over I")
    phase: float = knob(math.radians(3.0), unit="rad", low=-1.5, high=1.5, doc="departure from 90 degrees")
    offset: float = knob(0.0, unit="V", low=-10.0, high=10.0, doc="constant at the converter's input, in I and in Q")


@config
class ConverterConfig:
    """Analogue-to-digital converter: frames are then in counts, whole numbers from -2^(bits-1) to 2^(bits-1) - 1 in I and in Q."""

    bits: int = knob(12, unit="bit", low=1, high=24, doc="word length")
    full_scale: float = knob(2e-3, unit="V", low=1e-12, high=1e6, doc="largest input; without noise.gain: at the antenna")


@config
class ChirpFaultsConfig:
    """Chirps that the device loses or sends late."""

    dropped: float = knob(0.01, low=0.0, high=1.0, doc="share of chirps that are lost; the frame says which")
    late: float = knob(0.0, low=0.0, high=1.0, doc="share of chirps that start late; nothing says which")
    delay: float = knob(10e-6, unit="s", low=0.0, high=1.0, doc="the most by which a chirp is late, evenly distributed; within the pause")


PHYSICS = ("range_migration", "doppler_in_chirp", "squint", "curvature", "near_field")
"""Effects that are part of how echoes travel. Without any, an echo has one range, one range rate and one direction per frame."""


def _named(value: Any) -> Any:
    """``effects: auto``, ``noise:`` and ``noise: true`` mean what they seem to."""
    if value in (None, "auto"):
        return {"auto": value is not None}
    if not isinstance(value, dict):
        return value
    plain = {k: {} if (v is None or v is True) and k not in (*PHYSICS, "auto") else v for k, v in value.items()}
    return {k: True if v is None else v for k, v in plain.items() if v is not False or k in (*PHYSICS, "auto")}


@config
class Effects:
    """Effects act only where they are named, in the order of a real signal chain: the order in which a scene names them does not matter."""

    auto: bool = knob(False, doc="choose, beside those named, what is larger than the scene's tolerance; written as effects: auto")
    # what there is to see
    clutter: ClutterConfig | None = None
    occlusion: OcclusionConfig | None = None
    # how echoes travel
    multipath: MultipathConfig | None = None
    range_migration: bool = knob(False, doc="within a frame echoes move through range bins")
    doppler_in_chirp: bool = knob(False, doc="motion within a chirp shifts its beat frequency")
    squint: bool = knob(False, doc="the array's phases follow the swept frequency, not only the carrier")
    curvature: bool = knob(False, doc="range rates change within a frame")
    near_field: bool = knob(False, doc="wave fronts are spheres, not planes, over the array")
    # antennas and front end
    pattern: PatternConfig | None = None
    field_of_view: FieldOfViewConfig | None = None
    swerling: SwerlingConfig | None = None
    losses: LossesConfig | None = None
    high_pass: HighPassConfig | None = None
    channel_errors: ChannelErrorsConfig | None = None
    coupling: CouplingConfig | None = None
    phase_noise: PhaseNoiseConfig | None = None
    interference: InterferenceConfig | None = None
    noise: NoiseConfig | None = None
    iq_imbalance: IqImbalanceConfig | None = None
    converter: ConverterConfig | None = None
    chirp_faults: ChirpFaultsConfig | None = None


EffectsKnob = Annotated[Effects, BeforeValidator(_named)]
