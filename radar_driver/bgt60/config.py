"""What a BGT60TR13C is asked to measure, and where its receivers lie."""

from __future__ import annotations

from collections.abc import Sequence

from radar_core import AntennaArray, ConfigError, Pose, RadarInfo, Waveform
from radar_core.config import config, knob


@config
class Bgt60Config:
    """A BGT60TR13C on one of Infineon's boards."""

    uuid: str = knob("", doc="which of several boards, as handwave devices shows it; empty: the first one")
    start_frequency: float = knob(59.5e9, unit="Hz", low=57e9, high=64e9, doc="where the sweep begins")
    end_frequency: float = knob(61.5e9, unit="Hz", low=57e9, high=64e9, doc="where the sweep ends")
    sample_rate: float = knob(2e6, unit="Hz", low=1e5, high=4e6, doc="real samples a second")
    samples: int = knob(128, low=8, high=4096, doc="real samples of a chirp; half as many range cells")
    chirps: int = knob(64, low=2, high=1024, doc="chirps of a frame")
    chirp_interval: float = knob(300e-6, unit="s", low=1e-5, high=1e-1, doc="from one chirp to the next")
    frame_interval: float = knob(0.05, unit="s", low=1e-3, high=10.0, doc="from one frame to the next")
    tx_power: int = knob(31, low=0, high=31, doc="transmit power, in the chip's steps")
    gain: int = knob(33, unit="dB", low=18, high=60, doc="of the receivers")
    high_pass: int = knob(80_000, unit="Hz", low=20_000, high=160_000, doc="beats below this are held down: leakage, and what is very near")
    low_pass: int = knob(500_000, unit="Hz", low=100_000, high=2_000_000, doc="beats above this are held down")
    mirrored: bool = knob(False, doc="left and right change places")
    upside_down: bool = knob(False, doc="up and down change places")
    timeout: float = knob(2.0, unit="s", low=0.1, high=60.0, doc="no frame for so long is an error")
    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose()

    def validate(self) -> None:
        """Raise `ConfigError` when times or frequencies contradict each other."""
        if self.end_frequency <= self.start_frequency:
            raise ConfigError("Bgt60Config.end_frequency must be above start_frequency")
        if self.samples / self.sample_rate > self.chirp_interval:
            raise ConfigError("Bgt60Config: the samples take longer than chirp_interval; lengthen it, or take fewer")
        if self.chirps * self.chirp_interval > self.frame_interval:
            raise ConfigError("Bgt60Config: the chirps take longer than frame_interval; lengthen it, or send fewer")

    def info(self, bandwidth: float = 0.0, carrier: float = 0.0) -> RadarInfo:
        """Describe the radar; ``bandwidth`` is what is swept while samples are taken, ``carrier`` its middle [Hz]; 0: the whole sweep."""
        sampled = self.samples / self.sample_rate
        waveform = Waveform(
            carrier=carrier or (self.start_frequency + self.end_frequency) / 2,
            bandwidth=bandwidth or self.end_frequency - self.start_frequency,
            chirp_duration=sampled,
            chirp_pause=self.chirp_interval - sampled,
            frame_interval=self.frame_interval,
            n_tx=1,
            n_chirp=self.chirps,
            n_sample=(self.samples + 1) // 2,
        )
        array = bgt60_array((1, 2, 3), waveform.carrier, mirrored=self.mirrored, upside_down=self.upside_down)
        return RadarInfo(frame_id=self.frame_id, waveform=waveform, array=array, mount=self.mount)


def bgt60_array(rx: Sequence[int], carrier: float, *, mirrored: bool = False, upside_down: bool = False) -> AntennaArray:
    """Place receivers (1, 2 and 3): 1 and 3 beside each other, 2 and 3 above each other, half a wavelength of ``carrier`` [Hz] apart."""
    places = {3: (0.0, 0.0), 1: (1.0 if mirrored else -1.0, 0.0), 2: (0.0, -1.0 if upside_down else 1.0)}
    return AntennaArray.from_half_wavelengths([(0.0, 0.0)], [places[number] for number in rx], carrier)
