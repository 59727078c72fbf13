"""What can be set of a TinyRad, and the radar that it then is."""

from __future__ import annotations

import numpy as np

from radar_core import AntennaArray, ConfigError, Pose, RadarInfo, Waveform
from radar_core.config import config, knob
from radar_driver.tinyrad import registers, wire

_PAUSE = 22e-6  # s: what the board needs between the last sample and the next chirp
_TX = (-18.654e-3, 0.0)  # m, along the board
_RX_FIRST, _RX_STEP = 32.014e-3, 6.217e-3


@config
class TinyRadConfig:
    """Knobs of an EV-TINYRAD24G; the defaults give 50 frames a second, 0.6 m in range and 0.48 m/s in range rate."""

    port: str = knob("", doc="which of several boards: BUS-PORT as handwave devices shows it; empty: the only one")
    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose()
    start_frequency: float = knob(24.0e9, unit="Hz", low=registers.BAND[0], high=registers.BAND[1], doc="where a chirp begins")
    bandwidth: float = knob(250e6, unit="Hz", low=1e6, high=250e6, doc="how far a chirp rises during its ramp")
    ramp: float = knob(64e-6, unit="s", low=8e-6, high=4e-3, doc="how long a chirp rises, in whole microseconds")
    samples: int = knob(64, low=16, high=4096, doc="samples of a chirp, one a microsecond; the first is a counter")
    skip: int = knob(1, low=1, high=256, doc="samples left out at the beginning of a chirp: the counter, and what has not settled")
    period: float = knob(100e-6, unit="s", low=30e-6, high=10e-3, doc="start of one chirp to the start of the next")
    chirps: int = knob(64, low=1, high=4096, doc="recorded chirps per transmitter and frame")
    frame_interval: float = knob(20e-3, unit="s", low=1e-3, high=2.0, doc="start of one frame to the start of the next")
    sequence: tuple[int, ...] = knob((1, 2), choices=((1,), (2,), (1, 2), (2, 1)), doc="transmitters in the order in which they take turns")
    power: int = knob(100, low=0, high=100, doc="code of the transmitters' output power; not linear in dB")
    buffers: int = knob(4, low=2, high=64, doc="frames that the board keeps when they are not fetched in time")
    calibrate: bool = knob(True, doc="describe the channels as the calibration in the board's memory says")
    flipped: bool = knob(False, doc="the board is mounted upside down: left and right change places")
    timeout: float = knob(1.0, unit="s", low=0.05, high=10.0, doc="the board is opened anew when it is silent for that long")
    transfer: int = knob(0, unit="byte", low=0, high=1 << 20, doc="size of one USB read, in packets of 512; 0: a whole frame")
    temperature_interval: float = knob(10.0, unit="s", low=0.0, high=3600.0, doc="how often the temperature is asked for; 0: at the start")
    any_firmware: bool = knob(False, doc="use a board with another firmware than 3.x all the same")

    def validate(self) -> None:
        """Raise `ConfigError` when the board cannot do it."""
        registers.synthesiser(self.start_frequency, self.bandwidth, self.ramp)
        highest = self.start_frequency + self.bandwidth
        if highest > registers.BAND[1] * (1 + 1e-9):
            raise ConfigError(
                f"the chirp would end at {highest:.6g} Hz, above {registers.BAND[1]:.6g} Hz; lower start_frequency or bandwidth"
            )
        self._check_chirp()
        turn, rest = divmod(round(self.frame_interval * 1e8), round(self.period * 1e8) * len(self.sequence))
        if rest:
            raise ConfigError(
                f"frame_interval is {self.frame_interval:g} s; it must be a multiple of {len(self.sequence)} chirps of {self.period:g} s"
            )
        if turn < self.chirps:
            raise ConfigError(
                f"{len(self.sequence)} x {self.chirps} chirps take {self.chirps * self.period * len(self.sequence):g} s, longer than "
                f"frame_interval = {self.frame_interval:g} s; lengthen it or record fewer chirps"
            )
        if self.buffers * self.values > wire.RING_VALUES:
            most = wire.RING_VALUES // self.values
            raise ConfigError(
                f"buffers is {self.buffers}, but the board's memory holds {most} frames of {self.values} values"
                + ("" if most >= 2 else "; it needs 2: record fewer samples or chirps")
            )
        if self.transfer % wire.PACKET:
            raise ConfigError(f"transfer is {self.transfer}; it must be a multiple of {wire.PACKET}")

    def _check_chirp(self) -> None:
        if abs(self.ramp * 1e6 - round(self.ramp * 1e6)) > 1e-6:
            raise ConfigError(f"ramp is {self.ramp:g} s; the synthesiser counts whole microseconds")
        longest = self.samples / wire.SAMPLE_RATE
        if longest > self.ramp * (1 + 1e-9):
            raise ConfigError(f"{self.samples} samples take {longest:g} s, longer than the ramp of {self.ramp:g} s; take fewer")
        if self.samples - self.skip < 4:
            raise ConfigError(
                f"skip is {self.skip}: it leaves {self.samples - self.skip} of {self.samples} samples; at least 4 have to stay"
            )
        if self.period < self.ramp + _PAUSE - 1e-12:
            raise ConfigError(f"period is {self.period:g} s; a ramp of {self.ramp:g} s and the board's pause need {self.ramp + _PAUSE:g} s")

    @property
    def frame_chirps(self) -> int:
        """How often the sequence runs per frame, recorded or not."""
        return round(self.frame_interval / self.period / len(self.sequence))

    @property
    def values(self) -> int:
        """16-bit values of a frame."""
        return wire.N_RX * self.samples * self.chirps * len(self.sequence)

    def info(self) -> RadarInfo:
        """Describe the radar.

        Its complex samples are every second of the analytic signal, see `radar_driver.tinyrad.convert`: as many as the real ones have
        positive frequencies, over the same time.
        """
        n_real = self.samples - self.skip
        duration = n_real / wire.SAMPLE_RATE
        slope = registers.swept(self.bandwidth, self.ramp) / self.ramp
        waveform = Waveform(
            carrier=self.start_frequency + slope * (self.skip / wire.SAMPLE_RATE + duration / 2),
            bandwidth=slope * duration,
            chirp_duration=duration,
            chirp_pause=self.period - duration,
            frame_interval=self.frame_interval,
            n_tx=len(self.sequence),
            n_chirp=self.chirps,
            n_sample=(n_real + 1) // 2,
        )
        # The analytic signal reaches the converter's limit about when the real one does: an indication, `report` has the exact count.
        return RadarInfo(frame_id=self.frame_id, waveform=waveform, array=self._array(), mount=self.mount, full_scale=32768 * wire.VOLTS)

    def _array(self) -> AntennaArray:
        """Antennas around their phase centre, seen from behind the board with its plug down."""
        side = -1.0 if self.flipped else 1.0
        tx = np.array([_TX[number - 1] for number in self.sequence])
        rx = _RX_FIRST + _RX_STEP * np.arange(wire.N_RX)
        around = [tuple((float(side * y), 0.0) for y in place - place.mean()) for place in (tx, rx)]
        return AntennaArray(tx=around[0], rx=around[1], gain=13.0, tx_power=8.0)
