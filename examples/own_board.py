"""A board of your own in one file. This one needs no hardware: it computes the echo of a ball that swings before the radar.

handwave probe --board examples/own_board.py
handwave up --board examples/own_board.py

A real board differs in power_up (open the device), read (take a frame) and power_down (close it); docs/how-to/adding-a-board.md has
a file, a socket, a serial port and a maker's library.
"""

import time

import numpy as np

from radar_core import AntennaArray, Pose, RadarFrame, RadarInfo, Waveform
from radar_core.config import config, knob
from radar_driver.boards import Board
from radar_driver.sources import Reading, monotonic_ns

LIGHT = 299_792_458.0  # m/s


@config
class BallBoard:
    """What a user may set: `--param driver.ball.distance=3`."""

    distance: float = knob(2.0, unit="m", low=0.5, high=8.0, doc="of the middle of the swing")
    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose(z=1.2)


class Source:
    """Powered up, resumed, read, suspended and powered down by whoever uses it."""

    def __init__(self, settings):
        self.settings = settings
        waveform = Waveform(n_tx=1, n_chirp=32, n_sample=64, frame_interval=0.05)
        array = AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0), (1.95e-3, 0.0)))  # (y, z) [m]: half a wavelength apart
        self.info = RadarInfo(frame_id=settings.frame_id, waveform=waveform, array=array, mount=settings.mount)
        self.noise = np.random.default_rng(1)

    def power_up(self):
        """Open the device; here there is none."""

    def resume(self):
        """Let it send."""
        self.began, self.number = monotonic_ns(), 0

    def read(self, timeout):
        """Give the next frame, or None when none came within ``timeout`` seconds."""
        due = self.began + round(self.number * self.info.waveform.frame_interval * 1e9)
        wait = (due - monotonic_ns()) * 1e-9
        time.sleep(min(max(wait, 0.0), timeout))
        if wait > timeout:
            return None
        frame = RadarFrame(self.echo((due - self.began) * 1e-9), due, self.number, self.info.frame_id)
        self.number += 1
        return Reading(frame)

    def echo(self, seconds):
        """Compute the samples of one frame, axes (transmitter, chirp, receiver, sample): one tone, and noise."""
        wave = self.info.waveform
        chirps = seconds + np.arange(wave.n_chirp) * wave.chirp_interval
        distance = self.settings.distance + 0.3 * np.sin(2 * np.pi * 0.4 * chirps)
        delay = 2 * distance[:, None, None] / LIGHT
        samples = np.arange(wave.n_sample) * wave.chirp_duration / wave.n_sample
        slope = wave.bandwidth / wave.chirp_duration
        lowest = wave.carrier - wave.bandwidth / 2
        tone = np.exp(2j * np.pi * (lowest * delay + slope * delay * samples)) * np.ones((1, 2, 1))
        noise = self.noise.standard_normal((*tone.shape, 2)) @ np.array([0.1, 0.1j])
        return (tone + noise)[None].astype(np.complex64)

    def suspend(self):
        """Let it be silent."""

    def power_down(self):
        """Close the device."""

    def report(self):
        """Say what diagnostics should show."""
        return {"distance": self.settings.distance}


BOARD = Board("ball", "a ball that swings, computed", BallBoard, open=Source, find=lambda: ())
