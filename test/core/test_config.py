"""Configurations refuse what makes no sense and say where it stands."""

import dataclasses
from typing import Literal

import pytest

from radar_core import AntennaArray, ConfigError, Pose, RadarInfo, Waveform
from radar_core.config import config, describe, flat, knob, load, load_file, nest, override, plain
from radar_core.yaml_text import read_yaml
from radar_dsp.config import DoaConfig
from radar_sim import load_scene


@config
class _Sub:
    gain: float = knob(1.0, unit="dB", low=0, high=10, doc="how loud")
    names: tuple[str, ...] = knob(("a",), doc="a list of names")


@config
class _Top:
    mode: Literal["slow", "fast"] = knob("slow", doc="the pace")
    sub: _Sub = _Sub()
    parts: tuple[_Sub, ...] = ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mode: medium\n", r"top\.yaml:1: .*mode is 'medium'; choose one of 'slow', 'fast'"),
        ("mode: fast\nsub:\n  gain: 11\n", r"top\.yaml:\d: sub: _Sub\.gain is 11; it must be between 0 and 10 dB \(how loud\)"),
        ("mode: fast\nsub:\n  gian: 1\n", r"top\.yaml:3: unknown key 'sub\.gian' \(did you mean 'gain'\?\); known here: gain, names"),
        ("parts:\n  - gain: 1\n  - gain: loud\n", r"top\.yaml:3: parts\.1\.gain: .*valid number.*'loud'"),
        ("sub: 3\n", r"top\.yaml:1: sub: "),
        ("mode: [\n", r"top\.yaml: not valid YAML"),
        ("sub:\n  gain: .nan\n", r"_Sub\.gain is nan; it must be a finite number"),
    ],
)
def test_errors_name_file_line_and_key(tmp_path, text, message):
    """One message per mistake, with the place to look at."""
    path = tmp_path / "top.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_file(_Top, path)


def test_missing_file_is_named(tmp_path):
    """A path that does not exist is a user's mistake, not a traceback."""
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: cannot read it .* check the path"):
        load_file(_Top, tmp_path / "nowhere.yaml")


def test_load_equals_construct(tmp_path):
    """YAML and Python build the same object; an empty file means the defaults."""
    path = tmp_path / "top.yaml"
    path.write_text("mode: fast\nsub: {gain: 2.5, names: [x, y]}\nparts: [{gain: 3}]\n")
    assert load_file(_Top, path) == _Top(mode="fast", sub=_Sub(gain=2.5, names=("x", "y")), parts=(_Sub(gain=3.0),))
    path.write_text("")
    assert load_file(_Top, path) == _Top()


@config
class _Choosy:
    registered: str = knob("a", choices=("a", "b"), doc="one of a registry")
    order: Literal[1, -1] = knob(1, doc="which way")
    weather: Literal["sun", "rain"] | None = knob(None, doc="nothing is a choice too")
    colours: tuple[Literal["red", "green"], ...] = knob((), doc="any number of choices")
    free: str = knob("any", doc="no choice")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("registered", "c", r"registered is 'c'; choose one of 'a', 'b'"),
        ("order", 2, r"order is 2; choose one of 1, -1"),
        ("weather", "rein", r"weather is 'rein' \(did you mean 'rain'\?\); choose one of 'sun', 'rain'"),
        ("colours", ("red", "blue"), r"colours(\.1)? is 'blue'; choose one of 'red', 'green'"),
    ],
)
def test_choices_are_those_of_a_literal_or_of_the_knob(name, value, message):
    """What is not among them is refused with the same words in Python and in a file; what is, is taken."""
    with pytest.raises(ConfigError, match=rf"^_Choosy\.{message}"):
        _Choosy(**{name: value})
    with pytest.raises(ConfigError, match=message):
        load(_Choosy, {name: value})
    with pytest.raises(ConfigError, match=message):
        load(_Outer, {"choosy": {name: value}})
    told = {name: field.metadata["choices"] for name, field, _ in describe(_Choosy)}
    assert told == {
        "registered": ("a", "b"), "order": (1, -1), "weather": ("sun", "rain", None), "colours": ("red", "green"), "free": None
    }  # fmt: skip
    good = {"registered": "b", "order": -1, "weather": "sun", "colours": ["red", "red"], "free": "x"}
    assert flat(load(_Choosy, good)) == {**good, "colours": ("red", "red")}


@config
class _Outer:
    choosy: _Choosy = _Choosy()


@config
class _Loud:
    sub: _Sub = _Sub(gain=7.0)
    inner: _Top = _Top(mode="fast", sub=_Sub(names=("b", "c")))


def test_defaults_of_a_nested_configuration_are_those_of_the_one_around_it():
    """What stands around says what is inside unless the user does: listed, and loaded where only other knobs are given."""
    defaults = {name: field.default for name, field, _ in describe(_Loud)}
    assert defaults == {
        "sub.gain": 7.0, "sub.names": ("a",), "inner.mode": "fast", "inner.sub.gain": 1.0, "inner.sub.names": ("b", "c"), "inner.parts": ()
    }  # fmt: skip
    assert load(_Loud, nest(defaults)) == _Loud()
    assert load(_Loud, {"sub": {"names": ["z"]}, "inner": {"sub": {}}}) == _Loud(sub=_Sub(gain=7.0, names=("z",)))
    assert load(_Loud, {"inner": {"sub": {"gain": 3.0}}}).inner == _Top(mode="fast", sub=_Sub(gain=3.0, names=("b", "c")))
    assert describe(_Sub).__next__()[1].default == 1.0  # the class itself is as it was


@pytest.mark.parametrize(
    "made",
    [
        _Loud(),
        _Loud(sub=_Sub()),
        _Loud(inner=_Top()),
        _Loud(inner=_Top(mode="fast", sub=_Sub(gain=2.0))),
        _Loud(sub=_Sub(names=("a", "z"))),
    ],
)
def test_what_a_file_would_hold_makes_an_equal_configuration(made):
    """Whatever differs from what: nothing that is said is lost, and nothing is said that is the default."""
    assert load(_Loud, plain(made)) == made
    assert (plain(made) == {}) == (made == _Loud())


def test_some_knobs_over_another_configuration():
    """The others stay, also those that are not the defaults; one that there is not is named, and so is one out of range."""
    base = _Top(mode="fast", sub=_Sub(gain=5.0, names=("b",)))
    other = override(base, {"sub.gain": 7.0})
    assert other == _Top(mode="fast", sub=_Sub(gain=7.0, names=("b",)))
    assert override(other, {"sub.gain": 5.0, "mode": "slow"}) == _Top(sub=_Sub(gain=5.0, names=("b",)))
    assert override(other, {"sub.gain": 1.0}).sub.gain == 1.0  # a default, over what is none
    assert flat(other) == {"mode": "fast", "sub.gain": 7.0, "sub.names": ("b",), "parts": ()}
    assert override(_Top(), flat(other)) == other
    with pytest.raises(ConfigError, match=r"level 3: .*gian"):
        override(base, {"sub.gian": 1.0}, "level 3")
    with pytest.raises(ConfigError, match="must be between 0 and 10 dB"):
        override(base, {"sub.gain": 11.0})


def test_frozen_and_described():
    """A configuration cannot change under a processor, and lists its knobs with dotted names."""
    with pytest.raises(dataclasses.FrozenInstanceError):
        _Sub().gain = 2.0
    named = {name: field.metadata["unit"] for name, field, _ in describe(RadarInfo) if "doc" in field.metadata}
    assert named["waveform.carrier"] == "Hz"
    assert named["mount.tilt"] == "rad"
    assert load(RadarInfo, nest({"mount.z": 2.0, "frame_id": "left/radar"})) == RadarInfo(frame_id="left/radar", mount=Pose(z=2.0))


def test_info_must_agree_with_itself():
    """Waveform and array count the same transmitters."""
    with pytest.raises(ConfigError, match="uses 1 transmitters but the array has 2"):
        RadarInfo(waveform=Waveform(n_tx=1))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("duration: 1.0\nduration: 2.0\n", "the key 'duration' stands twice"),
        ("duration: true\n", "file.yaml:1: duration: is true, which is no number"),
        ("seed: 1\nduration: '2.0'\n", "file.yaml:2: duration: is '2.0': leave the quotes out"),
        ("points: [{position: [2.0, '0.5', 1.4], rcs: 0.1}]\n", "points.0.position.1: is '0.5': leave the quotes out"),
        ("a: " + 5000 * "[", "not valid YAML"),
        ("duration: 1" + 5000 * "0", "not valid YAML|finite|duration"),
    ],
)
def test_what_only_looks_like_it(tmp_path, text, said):
    """Keys that stand twice, true for a number, numbers in quotes, and depth without an end: refused, with the place."""
    (tmp_path / "file.yaml").write_text(text)
    with pytest.raises(ConfigError, match=said):
        load_scene(tmp_path / "file.yaml")


def test_one_is_not_true():
    """A switch takes true and false."""
    with pytest.raises(ConfigError, match="gate: is 1; write true or false"):
        load(DoaConfig, {"gate": 1})
    assert load(DoaConfig, {"gate": False}) == DoaConfig(gate=False)


@pytest.mark.parametrize(("text", "value"), [("77e9", 77e9), ("1e-3", 1e-3), ("-2.5E+3", -2500.0), ("'77e9'", "77e9"), ("e9", "e9")])
def test_numbers_as_people_write_them(text, value):
    """YAML 1.1 takes 77e9 for text."""
    assert read_yaml(text, "here") == value


def test_a_radar_that_cannot_be():
    """What a message says of itself is bounded before anything is set aside for it."""
    rx = tuple((0.0, 0.001 * k) for k in range(2000))
    with pytest.raises(ConfigError, match="larger than any radar's"):
        RadarInfo(array=AntennaArray(rx=rx))
    large = Waveform(n_chirp=1 << 16, n_sample=1 << 13, chirp_duration=1e-9, chirp_pause=0.0, frame_interval=100.0)
    with pytest.raises(ConfigError, match="larger than any radar's"):
        RadarInfo(waveform=large)
