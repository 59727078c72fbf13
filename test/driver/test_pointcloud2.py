"""PointCloud2 of any layout: every type, stride and byte order comes back; what contradicts itself is refused with topic and field."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, DataError
from radar_driver.foreign import ForeignConfig, foreign_cloud
from radar_ros.messages.pointcloud2 import read_fields

TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")


def field(name, offset, datatype=7, count=1):
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


def message(values, *, types=None, big=False, gap=0, padding=0, rows=1):
    """Lay values, each of shape (n,), out as a message does; ``gap`` bytes between fields, ``padding`` after a row."""
    types = types or ["f4"] * len(values)
    n = len(next(iter(values.values())))
    offsets, at = [], gap
    for kind in types:
        offsets.append(at)
        at += np.dtype(kind).itemsize + gap
    layout = np.dtype({"names": list(values), "formats": [(">" if big else "<") + k for k in types], "offsets": offsets, "itemsize": at})
    points = np.zeros(n, layout)
    for name, column in values.items():
        points[name] = column
    lines = points.reshape(rows, -1)
    data = b"".join(line.tobytes() + b"\xee" * padding for line in lines)
    fields = [field(name, o, TYPES.index(k) + 1) for name, o, k in zip(values, offsets, types, strict=True)]
    width = n // rows
    return SimpleNamespace(
        height=rows, width=width, fields=fields, is_bigendian=big, point_step=at, row_step=width * at + padding, data=data
    )


@given(
    st.lists(st.sampled_from(TYPES), min_size=1, max_size=5),
    st.booleans(),
    st.integers(0, 5),
    st.integers(0, 9),
    st.integers(1, 3),
    st.integers(0, 4),
    st.integers(0, 2**32),
)
def test_every_layout_comes_back(types, big, gap, padding, rows, columns, seed):
    """Values within each type's range, unaligned fields and padded rows included, exactly."""
    rng = np.random.default_rng(seed)
    n = rows * columns
    values = {}
    for k, kind in enumerate(types):
        info = np.iinfo(kind) if kind[0] in "iu" else None
        values[f"f{k}"] = rng.integers(info.min, info.max, n, endpoint=True) if info else rng.normal(size=n).astype(kind)
    msg = message(values, types=types, big=big, gap=gap, padding=padding, rows=rows)
    found = read_fields(msg, {name: name for name in values}, "/t")
    for name, sent in values.items():
        np.testing.assert_array_equal(found[name], np.asarray(sent, np.float64))


def test_fields_that_are_not_asked_for_do_not_matter():
    """Empty names are not there; foreign fields may be anything."""
    msg = message({"x": np.arange(3.0), "rgb": np.arange(3.0)})
    msg.fields.append(field("odd", 10_000, 99, 7))
    assert list(read_fields(msg, {"x": "x", "z": ""}, "/t")) == ["x"]


@pytest.mark.parametrize(
    ("change", "message_"),
    [
        ({"point_step": 0}, "point_step 0 and row_step 12 do not fit"),
        ({"row_step": 11}, "point_step 4 and row_step 11 do not fit"),
        ({"data": b"\0" * 11}, "data has 11 bytes, but 1 x 3 points need 12"),
        ({"width": 1 << 31, "height": 1 << 31}, "more than a radar gives"),
        ({"fields": [field("x", 1)]}, "field 'x' ends at byte 5 of a point of 4"),
        ({"fields": [field("x", 4294967295)]}, "field 'x' ends at byte 4294967299"),
        ({"fields": [field("x", 0, 9)]}, "field 'x' has the datatype 9"),
        ({"fields": [field("x", 0, 7, 3)]}, "field 'x' has 3 numbers a point"),
        ({"fields": [field("x", 0), field("x", 0)]}, "field 'x' is there 2 times"),
        ({"fields": [field("y", 0)]}, "has no field 'x'; it has: y. Name one of these"),
        ({"fields": []}, "it has: none"),
    ],
)
def test_nonsense_is_refused(change, message_):
    """Topic and what is wrong are named."""
    msg = message({"x": np.arange(3.0)})
    for name, value in change.items():
        setattr(msg, name, value)
    with pytest.raises(DataError, match=f"/radar/cloud: .*{message_}"):
        read_fields(msg, {"x": "x"}, "/radar/cloud")


def test_an_empty_cloud_is_a_cloud():
    """Nobody there: no data, whatever the steps say."""
    msg = SimpleNamespace(height=1, width=0, fields=[field("x", 0)], is_bigendian=False, point_step=0, row_step=0, data=b"")
    assert len(read_fields(msg, {"x": "x"}, "/t")["x"]) == 0


def test_meaning_of_the_fields():
    """TI's axes, a sign, and amplitudes; what is no number is left out or NaN."""
    nan = np.nan
    values = {
        "x": np.array([1.0, 1.0, nan, 1e9]),
        "y": np.array([2.0, 2.0, 2.0, 2.0]),
        "z": np.array([0.5, 0.5, 0.5, 0.5]),
        "doppler": np.array([0.3, nan, 0.0, 0.0]),
        "intensity": np.array([10.0, -1.0, 1.0, 1.0]),
    }
    settings = ForeignConfig(axes="ti", doppler_sign=-1, intensity_unit="amplitude")
    cloud, refused = foreign_cloud(values, settings, 5, 7, "radar")
    assert (len(cloud), refused, cloud.stamp_ns, cloud.sequence) == (2, 2, 5, 7)
    np.testing.assert_allclose(cloud.position[0], [2.0, -1.0, 0.5])
    np.testing.assert_allclose(cloud.range, np.sqrt(5.25), rtol=1e-6)
    np.testing.assert_allclose(cloud.azimuth, np.arctan2(-1, 2), rtol=1e-6)
    np.testing.assert_allclose(cloud.radial_speed, [-0.3, nan], rtol=1e-6)
    np.testing.assert_allclose(cloud.snr, [20.0, nan], rtol=1e-6)
    assert np.isnan(cloud.noise).all()


def test_a_radar_without_height():
    """No z: points at the radar's own height, elevation unknown."""
    cloud, _ = foreign_cloud({"x": np.ones(1), "y": np.ones(1)}, ForeignConfig(z="", doppler="", intensity=""), 0, 0, "radar")
    assert cloud.z[0] == 0.0
    assert np.isnan([cloud.elevation[0], cloud.radial_speed[0], cloud.snr[0]]).all()
    with pytest.raises(ConfigError, match=r"ForeignConfig\.x is empty"):
        ForeignConfig(x="")
