"""What calibrating an antenna array is worth: errors of azimuth before and after, mounting offsets, and the thesis's table (3.1).

Simulated turntables, arrays with errors of 30 degrees, 2 dB and 0.2 mm (rms, per channel).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from radar_core import AntennaArray, RadarInfo
from radar_lab.arrays.calibration import Calibration, Calibrator
from radar_lab.arrays.turntable import gather
from radar_sim.turntable import ChannelErrors, Sweep, Turntable, TurntableSimulator

INFO: Final = RadarInfo()
WAVELENGTH: Final = INFO.waveform.wavelength
SEEDS: Final = 10
LEVELS: Final = (0, 20, -20)  # degrees of elevation
NOISE: Final[Mapping[str, float | None]] = {"no noise": None, "30 dB": 30.0, "25 dB": 25.0, "20 dB": 20.0}  # SNR of a channel
KNOWN: Final = ((50, 0), (50, 10), (50, 20), (50, 30), (20, 30))  # degrees: azimuth and elevation that a table is asked for


def azimuth(array: AntennaArray, snapshot: NDArray[np.complexfloating]) -> float:
    """Azimuth [degrees] by maximum likelihood over both angles (2.16): grid, then simplex."""
    grid = np.stack(np.meshgrid(np.radians(np.arange(-72, 73, 3)), np.radians(np.arange(-42, 43, 7)), indexing="ij"))

    def cost(direction: NDArray[np.float64]) -> NDArray[np.float64]:
        a = array.steering(direction[0], direction[1], WAVELENGTH)
        power = np.abs(a.conj() @ snapshot) ** 2 / (np.abs(a) ** 2).sum(axis=-1) / np.vdot(snapshot, snapshot).real
        return np.asarray(-power, np.float64)

    best = grid.reshape(2, -1)[:, int(np.argmin(cost(grid)))]
    return math.degrees(minimize(cost, best, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-12}).x[0])


def bias(true: AntennaArray, believed: AntennaArray, elevation: float, step: int = 5) -> float:
    """Largest azimuth error [degrees] over +-50 degrees, noiseless."""
    angles = range(-50, 51, step)
    return max(abs(azimuth(believed, true.steering(math.radians(a), math.radians(elevation), WAVELENGTH)) - a) for a in angles)


def spread(errors: Sequence[Sequence[float]], levels: Sequence[int]) -> dict[str, dict[str, float]]:
    """Median and worst over arrays [degrees], by elevation."""
    return {
        str(level): {"median": float(np.median(column)), "worst": max(column)}
        for level, column in zip(levels, zip(*errors, strict=True), strict=True)
    }


def biases(seeds: int, levels: Sequence[int], step: int) -> dict[str, Any]:
    """Azimuth errors by signal-to-noise ratio of the turntable's frames."""
    before = [TurntableSimulator(Turntable(errors=ChannelErrors(seed=seed))).array for seed in range(seeds)]
    found = {"not calibrated": spread([[bias(true, INFO.array, level, step) for level in levels] for true in before], levels)}
    for name, snr in NOISE.items():
        errors = []
        for seed in range(seeds):
            simulator = TurntableSimulator(Turntable(errors=ChannelErrors(seed=seed), snr=snr, seed=seed))
            result = Calibrator(Calibration(), simulator.info).process(gather(simulator, simulator.info))
            errors.append([bias(simulator.array, result.array, level, step) for level in levels])
        found[name] = spread(errors, levels)
    return found


def known(angles: NDArray[np.floating]) -> list[list[float | None]]:
    """Give angles in degrees, None for those that were not fitted: of each sweep azimuth and elevation."""
    return [[math.degrees(one) if math.isfinite(one) else None for one in row] for row in angles.tolist()]


def offsets() -> dict[str, dict[str, Any]]:
    """Mounting offsets that are fitted where the array was turned by 2 degrees, and what is left over without and with them."""
    found = {}
    for name, sweeps in {"azimuth": (Sweep(),), "both": (Sweep(), Sweep(axis="elevation", start=-30.0, stop=30.0))}.items():
        simulator = TurntableSimulator(Turntable(sweeps=sweeps, offset_azimuth=2.0, snr=30.0))
        snapshots = gather(simulator, simulator.info)
        plain = Calibrator(Calibration(), simulator.info).process(snapshots)
        result = Calibrator(Calibration(offsets=True), simulator.info).process(snapshots)
        found[name] = {
            "offset_degrees": known(result.offset),
            "deviation_degrees": known(result.offset_std),
            "structure_without": plain.structure,
            "structure_with": result.structure,
        }
    return found


def table_of_thesis() -> dict[str, dict[str, float]]:
    """Read the table of (3.1), and the fit, for known directions [degrees]."""
    simulator = TurntableSimulator(Turntable(snr=None))
    result = Calibrator(Calibration(method="outer"), simulator.info).process(gather(simulator, simulator.info))
    assert result.table is not None
    found = {}
    for true in KNOWN:
        snapshot = simulator.array.steering(math.radians(true[0]), math.radians(true[1]), WAVELENGTH)
        read = {"table": math.degrees(result.table.direction(snapshot)[0]), "fit": azimuth(result.array, snapshot)}
        found["{} at {}".format(*true)] = read
    return found


def run(quick: bool) -> dict[str, Any]:
    """Measure ten arrays at three elevations; quick: two at one."""
    found = biases(2, (0,), 25) if quick else biases(SEEDS, LEVELS, 5)
    return {"azimuth_error_degrees": found, "offsets": offsets(), "outer": table_of_thesis(), "choices": []}
