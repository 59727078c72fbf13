"""A calibrated array: what calibration found, its file, and how it gets into a radar's description."""

from __future__ import annotations

import dataclasses
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, ConfigError, HandwaveError, RadarInfo
from radar_core.checks import require_finite, require_shape
from radar_core.config import load
from radar_core.files import replacing

Float64Array = NDArray[np.float64]

FORMAT: Final = 1  # version of the file; a reader refuses every other

_ARRAYS: Final = ("dead", "phase_residual", "gain_residual", "gain_std", "phase_std", "shift_std", "offset", "offset_std")
_NUMBERS: Final = ("carrier", "condition", "structure", "range")
_TABLE: Final = ("azimuth", "elevation", "vectors")
_ADVICE: Final = "make one with `handwave calibrate RECORDING -o array.npz`"
_SAME: Final = 1e-6  # positions differ when they do by more than this [m]; carriers, by more than a thousandth
_WEAK: Final = np.radians(1.0)
_STRUCTURE: Final = 0.5
_VISIBLE: Final = 0.02


@dataclass(frozen=True, eq=False)
class SteeringTable:
    """The thesis's steering matrix on a grid: outer product of an azimuth and an elevation sweep over the boresight vector (3.1).

    Kept for comparison. For ideal channels its phase is -2 pi / lambda (p_y sin(azimuth) + p_z sin(elevation)); the true one has p_y
    cos(elevation) sin(azimuth). So away from elevation 0 it reads sin(azimuth) too small by cos(elevation): 41.6 degrees for 50 at an
    elevation of 30.

    Attributes
    ----------
    azimuth, elevation : ndarray of float64, shape (n_azimuth,), (n_elevation,)
        Grid, ascending [rad].
    vectors : ndarray of complex128, shape (n_azimuth, n_elevation, n_channel)
        Steering vectors; dead channels are zero. A `DataError` says that the shapes disagree or a number is not finite.
    """

    azimuth: NDArray[np.float64]
    elevation: NDArray[np.float64]
    vectors: NDArray[np.complex128]

    def __post_init__(self) -> None:
        require_shape("SteeringTable.vectors", self.vectors, (len(self.azimuth), len(self.elevation), None))
        for name in ("azimuth", "elevation", "vectors"):
            require_finite(f"SteeringTable.{name}", getattr(self, name))

    def direction(self, snapshot: NDArray[np.complex128]) -> tuple[float, float]:
        """Azimuth and elevation [rad] of the best entry for a detection's amplitudes, ``snapshot`` (n_channel,): the likelihood (2.16).

        A `DataError` says that the number of channels is not the table's.
        """
        require_shape("snapshot", snapshot, (self.vectors.shape[-1],))
        norm = np.linalg.norm(self.vectors, axis=-1)
        score = np.abs(self.vectors.conj() @ snapshot) / np.where(norm > 0, norm, np.inf)
        i, j = np.unravel_index(int(np.argmax(score)), score.shape)
        return float(self.azimuth[i]), float(self.elevation[j])


@dataclass(frozen=True, eq=False)
class CalibratedArray:
    """What calibration found.

    Attributes
    ----------
    array : AntennaArray
        The nominal array with gain, phase and shift of every channel.
    carrier : float
        Frequency for which phases and gains hold [Hz].
    dead : ndarray of bool, shape (n_channel,)
        Channels without signal; they get a gain of -100 dB.
    observed : tuple of (bool, bool)
        Whether shifts along y and along z were fitted; those that were not are zero.
    phase_residual, gain_residual : ndarray of float64, shape (n_channel,)
        Rms of what the fit leaves [rad], [dB]; NaN for dead channels.
    gain_std, phase_std, shift_std : ndarray of float64, shape (n_channel,), (n_channel,), (n_channel, 2)
        Standard deviations from the residuals [dB], [rad], along y and z [m]: noise only; NaN where not observed.
    condition : float
        Condition number of the regression on (1, u_y, u_z) with unit columns; near 1: the angles tell gain, phase and shift well apart.
    structure : float
        Correlation of the residual phases of neighbouring angles, -1 to 1. Near 0: noise. Near 1: something that the model lacks.
    offset, offset_std : ndarray of float64, shape (n_sweep, 2)
        Fitted mounting offset of each sweep, true minus stated (azimuth, elevation) [rad], and its standard deviation; NaN: not fitted.
    range, n_snapshot : float, int
        Distance of the reflector [m]; how many snapshots went in.
    table : SteeringTable or None
        Equation 3.1, of method ``outer``.
    """

    array: AntennaArray
    carrier: float
    dead: NDArray[np.bool_]
    observed: tuple[bool, bool]
    phase_residual: Float64Array
    gain_residual: Float64Array
    gain_std: Float64Array
    phase_std: Float64Array
    shift_std: Float64Array
    condition: float
    structure: float
    offset: Float64Array
    offset_std: Float64Array
    range: float
    n_snapshot: int
    table: SteeringTable | None = None

    def notes(self) -> list[str]:
        """Sentences on what a user has to know; empty: all is well."""
        notes = [
            f"shifts along {axis} are not observable from these angles; they stay 0"
            for axis, seen in zip("yz", self.observed, strict=True)
            if not seen
        ]
        if self.dead.any():
            notes.append(
                f"channels {np.flatnonzero(self.dead).tolist()} (tx * n_rx + rx) give no signal; directions are found without them"
            )
        if self.structure > _STRUCTURE and np.nanmean(self.phase_residual) > _VISIBLE:
            notes.append(
                "what the fit leaves is no noise, it changes smoothly with the angle: start or step may be wrong, the mounting askew "
                "(calibrate with offsets), or there are reflections beside the reflector"
            )
        limit = 3 * float(np.nanmedian(self.phase_residual)) + 1e-3
        odd = np.flatnonzero(np.nan_to_num(self.phase_residual) > limit).tolist()
        if odd:
            notes.append(f"channels {odd} fit badly: their phase is off by three times what it is in the others")
        weak = sorted({int(i) for i in np.argwhere(np.nan_to_num(self.offset_std) > _WEAK)[:, 0]})
        if weak:
            notes.append(f"mounting offsets of sweeps {weak} are hardly seen (standard deviation over 1 degree); calibrate without offsets")
        return notes


def save_array(result: CalibratedArray, path: str | Path) -> None:
    """Write a calibration to ``path`` (.npz): plain arrays and JSON text, no pickles; a `ConfigError` says that it cannot be written."""
    path = Path(path)
    about = {"array": dataclasses.asdict(result.array), "observed": list(result.observed), "n_snapshot": result.n_snapshot}
    about |= {name: getattr(result, name) for name in _NUMBERS}
    content: dict[str, Any] = {name: getattr(result, name) for name in _ARRAYS}
    if result.table is not None:
        content |= {f"table_{name}": getattr(result.table, name) for name in _TABLE}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial, partial.open("wb") as file:
            np.savez(file, allow_pickle=False, format=np.int64(FORMAT), about=np.array(json.dumps(about)), **content)
    except OSError as error:
        raise ConfigError(f"{path}: cannot write the calibration ({error.strerror or error}); choose another place") from None


def load_array(path: str | Path) -> CalibratedArray:
    """Read a calibration.

    A `ConfigError` says that there is no such file, that it is no calibration, or one of another version, and what to do.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {key: file[key] for key in file.files}
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such calibration; check the path, or {_ADVICE}") from None
    except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path}: not a calibration ({error}); {_ADVICE}") from None
    missing = {"format", "about", *_ARRAYS} - content.keys()
    if missing:
        raise ConfigError(f"{path}: not a calibration: it has no {', '.join(sorted(missing))}; {_ADVICE}")
    if content["format"].shape != () or int(content["format"]) != FORMAT:
        raise ConfigError(f"{path}: calibration format {content['format']}, but this version of Handwave reads format {FORMAT}; {_ADVICE}")
    try:
        return _build(content)
    except (HandwaveError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path}: not a calibration that can be used ({error}); {_ADVICE}") from None


def _build(content: dict[str, Any]) -> CalibratedArray:
    about = json.loads(str(content["about"]))
    array = load(AntennaArray, about["array"])
    n = array.n_tx * array.n_rx
    for name in _ARRAYS:
        wanted: tuple[int | None, ...] = (None, 2) if name.startswith("offset") else (n, 2) if name == "shift_std" else (n,)
        shape = content[name].shape
        if len(shape) != len(wanted) or any(w not in (None, g) for w, g in zip(wanted, shape, strict=True)):
            raise ConfigError(f"{name} has shape {shape} for {n} channels")
    table = SteeringTable(*(content[f"table_{name}"] for name in _TABLE)) if "table_vectors" in content else None
    observed, n_snapshot = (bool(about["observed"][0]), bool(about["observed"][1])), int(about["n_snapshot"])
    values: dict[str, Any] = {**{name: content[name] for name in _ARRAYS}, **{name: float(about[name]) for name in _NUMBERS}}
    return CalibratedArray(array=array, observed=observed, n_snapshot=n_snapshot, table=table, **values)


def calibrate_info(info: RadarInfo, result: CalibratedArray) -> RadarInfo:
    """Put a calibration (gain, phase and shift of every channel) into a radar's description; it replaces an earlier one.

    Mount, power and field of view stay. A `ConfigError` says that the calibration is of another array or another carrier.
    """
    for name in ("tx", "rx"):
        own, other = (np.asarray(getattr(array, name), np.float64) for array in (info.array, result.array))
        if own.shape != other.shape or np.abs(own - other).max() > _SAME:
            raise ConfigError(
                f"the calibration is of an array with other {name} positions ({len(other)} elements) than that of radar "
                f"{info.frame_id!r} ({len(own)}); calibrate this radar, or correct its array"
            )
    carrier = info.waveform.carrier
    if abs(carrier - result.carrier) > 1e-3 * carrier:
        raise ConfigError(
            f"the calibration holds at {result.carrier * 1e-9:.3f} GHz, but the radar's carrier is {carrier * 1e-9:.3f} GHz; the phases of "
            "its lines change with it: calibrate at that carrier"
        )
    measured = {name: getattr(result.array, name) for name in ("channel_gain", "channel_phase", "channel_shift")}
    return dataclasses.replace(info, array=dataclasses.replace(info.array, **measured))
