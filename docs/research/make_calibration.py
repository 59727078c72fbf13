"""Figures and picture of docs/how-to/calibration.md, from simulated turntables.

python docs/research/make_calibration.py  # the tables, and docs/img/ambiguity.png
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from radar_core import AntennaArray, RadarInfo
from radar_lab.arrays.ambiguity import plot
from radar_lab.arrays.calibration import Calibration, Calibrator
from radar_lab.arrays.turntable import gather
from radar_sim.turntable import ChannelErrors, Sweep, Turntable, TurntableSimulator

INFO = RadarInfo()
WAVELENGTH = INFO.waveform.wavelength
SEEDS = 10
LEVELS = (0.0, 20.0, -20.0)


def azimuth(array: AntennaArray, snapshot: np.ndarray) -> float:
    """Azimuth [deg] by maximum likelihood over both angles (2.16): grid, then simplex."""
    grid = np.stack(np.meshgrid(np.radians(np.arange(-72, 73, 3)), np.radians(np.arange(-42, 43, 7)), indexing="ij"))

    def cost(direction: np.ndarray) -> np.ndarray:
        a = array.steering(direction[0], direction[1], WAVELENGTH)
        return -(np.abs(a.conj() @ snapshot) ** 2) / (np.abs(a) ** 2).sum(axis=-1) / np.vdot(snapshot, snapshot).real

    best = grid.reshape(2, -1)[:, int(np.argmin(cost(grid)))]
    return math.degrees(minimize(cost, best, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-12}).x[0])


def bias(true: AntennaArray, believed: AntennaArray, elevation: float) -> float:
    """Largest azimuth error [deg] over +-50 degrees in steps of five, noiseless."""
    angles = range(-50, 51, 5)
    return max(abs(azimuth(believed, true.steering(math.radians(a), math.radians(elevation), WAVELENGTH)) - a) for a in angles)


def row(label: str, figures: list[list[float]]) -> None:
    """Print median and worst over the seeds for each elevation."""
    columns = np.array(figures).T
    print(f"| {label} | " + " | ".join(f"{np.median(c):.3f} / {c.max():.3f}" for c in columns) + " |")


def biases() -> None:
    """Print azimuth bias before and after, over seeds and signal-to-noise ratios."""
    print(f"| largest azimuth error over +-50 deg [deg], median / worst of {SEEDS} arrays | el 0 | el +20 | el -20 |\n|---|---|---|---|")
    before = [TurntableSimulator(Turntable(errors=ChannelErrors(seed=seed))).array for seed in range(SEEDS)]
    row("not calibrated", [[bias(true, INFO.array, level) for level in LEVELS] for true in before])
    for snr in (None, 30.0, 25.0, 20.0):
        figures = []
        for seed in range(SEEDS):
            simulator = TurntableSimulator(Turntable(errors=ChannelErrors(seed=seed), snr=snr, seed=seed))
            found = Calibrator(Calibration(), simulator.info).process(gather(simulator, simulator.info)).array
            figures.append([bias(simulator.array, found, level) for level in LEVELS])
        row("no noise" if snr is None else f"{snr:.0f} dB per channel", figures)


def offsets() -> None:
    """Print fitted mounting offsets."""
    for sweeps in ((Sweep(),), (Sweep(), Sweep(axis="elevation", start=-30.0, stop=30.0))):
        simulator = TurntableSimulator(Turntable(sweeps=sweeps, offset_azimuth=2.0, snr=30.0))
        snapshots = gather(simulator, simulator.info)
        plain = Calibrator(Calibration(), simulator.info).process(snapshots)
        result = Calibrator(Calibration(offsets=True), simulator.info).process(snapshots)
        values, deviations = np.degrees(result.offset), np.degrees(result.offset_std)
        found = [f"({v[0]:.2f} +- {d[0]:.2f}, {v[1]:.2f} +- {d[1]:.2f})" for v, d in zip(values, deviations, strict=True)]
        print(f"offset 2 deg, {len(sweeps)} sweep(s): found {found}; structure {plain.structure:.2f} without, {result.structure:.2f} with")


def outer() -> None:
    """Print what the table of (3.1) and the fit read for known directions."""
    simulator = TurntableSimulator(Turntable(snr=None))
    result = Calibrator(Calibration(method="outer"), simulator.info).process(gather(simulator, simulator.info))
    assert result.table is not None
    for true in ((50, 0), (50, 10), (50, 20), (50, 30), (20, 30)):
        snapshot = simulator.array.steering(*np.radians(true), WAVELENGTH)
        table = math.degrees(result.table.direction(snapshot)[0])
        print(f"azimuth/elevation {true}: table (3.1) reads {table:.0f}, fit {azimuth(result.array, snapshot):.2f}")


def main() -> None:
    """Print everything and draw the picture."""
    biases()
    offsets()
    outer()
    for item in plot(INFO.array, WAVELENGTH, Path(__file__).resolve().parents[1] / "img" / "ambiguity.png"):
        print(
            f"{item.axis}: unambiguous +-{math.degrees(item.unambiguous):.1f} deg, side lobes in view {item.side_lobe:.2f}, "
            f"beamwidth {math.degrees(item.beamwidth):.1f} deg"
        )


if __name__ == "__main__":
    main()
