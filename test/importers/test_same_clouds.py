"""A simulated scene's clouds written in each format of clouds come back as the same echoes: those above 20 dB within half a deviation.

Formats that round to millimetres may be off by that where it is more: a deviation of strong echoes is less than their rounding.
"""

import numpy as np
import pytest
from test_import_clouds import write_mars_tables
from test_same_echoes import MEASURED, cubes_of

from radar_core import AntennaArray, PointCloud, RadarFrame, RadarInfo, Waveform
from radar_dsp import Baseband, BasebandConfig
from radar_lab.importers import open_original
from radar_lab.importers.mars import MarsOptions

N = 3


@pytest.fixture(scope="module")
def clouds():
    """Three clouds of three echoes, of a radar that sees azimuth and elevation."""
    waveform = Waveform(
        carrier=60.5e9, bandwidth=2e9, chirp_duration=64e-6, chirp_pause=36e-6, frame_interval=0.1, n_tx=2, n_chirp=32, n_sample=64
    )
    array = AntennaArray.from_half_wavelengths([(0.0, 0.0), (0.0, 1.0)], [(float(k), 0.0) for k in range(4)], waveform.carrier)
    info = RadarInfo(waveform=waveform, array=array)
    baseband = Baseband(BasebandConfig(), info)
    made = [baseband.process(RadarFrame(cube.astype(np.complex64), 0, k, "radar")) for k, cube in enumerate(cubes_of(info, rcs=1e-4, n=N))]
    return [cloud.select(np.isfinite(cloud.elevation)) for cloud in made]


def ti_axes(clouds):
    """Right, forward, up of all points; the end of each cloud, from 0 on."""
    place = np.concatenate([np.stack([-c.y, c.x, c.z], axis=-1) for c in clouds]).astype(np.float64)
    return place, np.append(0, np.cumsum([len(c) for c in clouds])).astype(np.int64)


def joined(clouds, name):
    return np.concatenate([getattr(cloud, name) for cloud in clouds]).astype(np.float64)


def crossing(folder, clouds):
    """Angles to the right, heights from 0.7 m below the radar, powers 90 dB above the floor."""
    place, offset = ti_axes(clouds)
    angles = [joined(clouds, "range"), -joined(clouds, "azimuth"), joined(clouds, "elevation")]
    points = np.stack(
        [place[:, 0], place[:, 1], place[:, 2] + 0.7, *angles, joined(clouds, "radial_speed"), joined(clouds, "snr") + 90], axis=-1
    )
    number = np.arange(N)
    np.savez(folder / "a.npz", offset=offset, time_ms=100.0 * number, frame_number=number, points=points.astype(np.float32))
    return open_original("crossing", folder / "a.npz", min_speed=0.0)


def millimetres(values, kind=np.int16):
    return np.round(values * 1e3).astype(kind)


def segments(folder, clouds):
    """Whole millimetres, as the packing has them."""
    place, offset = ti_axes(clouds)
    about = {"label": np.array(["push"]), "subject": np.array([1], np.uint16), "distance_m": np.array([2.0], np.float32)}
    rows = {"frame": np.repeat(np.arange(N), np.diff(offset)).astype(np.uint16), "xyz_mm": millimetres(place)}
    rows |= {"doppler_mm_s": millimetres(joined(clouds, "radial_speed")), "intensity": amplitude(clouds).round().astype(np.uint16)}
    np.savez(folder / "a.npz", offset=offset[[0, -1]], **about, **rows)
    return open_original("mhomeges", folder / "a.npz", idle=0.0)


def amplitude(clouds):
    return 10 ** (joined(clouds, "snr") / 20)


def rows_of_text(folder, clouds):
    """The originals' rows, with a label in the path."""
    place, offset = ti_axes(clouds)
    frame, count = np.repeat(np.arange(N), np.diff(offset)), np.repeat(np.diff(offset), np.diff(offset))
    table = np.column_stack([frame, count, place, joined(clouds, "radial_speed"), amplitude(clouds)])
    np.savetxt(folder / "PS_1.csv", table, "%.6g", ",", header="frame,points,x,y,z,doppler,intensity", comments="")
    return open_original("mtranssee", folder / "PS_1.csv", idle=0.0)


def mars_data(clouds):
    place, offset = ti_axes(clouds)
    joints = {"joints": np.array(["SpineBase", "HandLeft", "HandRight"]), "joint_xyz": np.full((N, 3, 3), 2.0)}
    points = {"xyz": place, "doppler": joined(clouds, "radial_speed"), "intensity": amplitude(clouds)}
    return {"offset": offset, **points, **joints}


def mars(folder, clouds):
    np.savez(folder / "subject1.npz", **mars_data(clouds))
    return open_original("mars", folder / "subject1.npz", height=MarsOptions().height)


def mars_tables(folder, clouds):
    return open_original("mars", write_mars_tables(folder, mars_data(clouds)))


def radhar(folder, clouds):
    """Our axes; whole millimetres."""
    _, offset = ti_axes(clouds)
    place = np.concatenate([cloud.position for cloud in clouds])
    rows = {"xyz_mm": millimetres(place), "doppler_mm_s": millimetres(joined(clouds, "radial_speed"))}
    rows["intensity_cdb"] = np.round(100 * joined(clouds, "snr")).astype(np.int16)
    about = {"name": np.array(["a"]), "activity": np.array(["walk"]), "recording": np.zeros(N, np.int64), "stamp_ms": 33 * np.arange(N)}
    np.savez(folder / "a.npz", offset=offset, **about, **rows)
    return open_original("radhar", folder / "a.npz")


def radhar_text(folder, clouds):
    """What ``rostopic echo`` prints."""
    lines = []
    for k, cloud in enumerate(clouds):
        for i in range(len(cloud)):
            values = {"secs": 1, "nsecs": k * 33_000_000, "point_id": i, "x": cloud.x[i], "y": cloud.y[i], "z": cloud.z[i]}
            values |= {"velocity": cloud.radial_speed[i], "intensity": cloud.snr[i]}
            lines += [f"{name}: {value}" for name, value in values.items()]
    (folder / "a.txt").write_text("\n".join(lines) + "\n")
    return open_original("radhar", folder / "a.txt")


ROUNDED = {
    "range": 0.9e-3,
    "radial_speed": 0.5e-3,
    "azimuth": 0.7e-3,
    "elevation": 0.7e-3,
}  # of half millimetres in x, y and z, from 1.2 m on


@pytest.mark.parametrize("write", [crossing, segments, rows_of_text, mars, mars_tables, radhar, radhar_text])
def test_the_same_echoes_come_back(tmp_path, clouds, write):
    """Range, range rate, azimuth and elevation of each; as many clouds and points as were written."""
    back = [item for item in write(tmp_path, clouds).items if isinstance(item, PointCloud)]
    assert [len(cloud) for cloud in back] == [len(cloud) for cloud in clouds]
    least = ROUNDED if write in (segments, radhar) else dict.fromkeys(ROUNDED, 1e-5)  # else: six digits
    compared = 0
    for sure, found in zip(clouds, back, strict=True):
        strong = np.flatnonzero(sure.snr > 20)
        for name in MEASURED:
            error = np.abs(getattr(found, name)[strong] - getattr(sure, name)[strong])
            assert (error < np.maximum(0.5 * getattr(sure, f"{name}_std")[strong], least[name])).all(), name
        compared += len(strong)
    assert compared >= 9
