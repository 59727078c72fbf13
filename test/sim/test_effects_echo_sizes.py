"""Sizes that effects on echoes say of themselves, against what they do."""

import dataclasses
import math
import re

import numpy as np
import pytest
from echo_settings import (
    CHI_SQUARE,
    MOMENT,
    POINTS,
    SETTING,
    echoes_at,
    polar,
    setting_of,
)

from radar_core import SPEED_OF_LIGHT, AntennaArray, RadarInfo, Waveform
from radar_sim.effects import config, echo, multipath, physics, sight
from radar_sim.effects.base import Setting
from radar_sim.people import Person
from radar_sim.scene import Scene, SceneRadar


def number(text: str) -> float:
    """First number of a line."""
    return float(re.search(r"-?\d+\.?\d*(e-?\d+)?", text).group())


def test_sizes_of_effects():
    """One line each, in the unit that is natural to it."""
    echoes = echoes_at([polar(0, 0), polar(60, 0), polar(70, 0, 6.0)])
    assert (
        echo.Pattern(config.PatternConfig(), SETTING).size(echoes.select(np.array([0, 1])))
        == "-6.0 dB two-way at the echo farthest from boresight"
    )
    # Of three echoes of equal strength, the one beyond has (1/2)^4 of the power of each of the others: 1/33, -15.2 dB.
    assert echo.FieldOfView(config.FieldOfViewConfig(), SETTING).size(echoes) == "1 of 3 echoes are beyond, with -15.2 dB of the power"
    assert echo.FieldOfView(config.FieldOfViewConfig(), SETTING).size(echoes.select(np.array([0]))) == "none of 1 echoes is beyond"
    assert echo.Losses(config.LossesConfig(level=25.0), SETTING).size(echoes) == "-25.0 dB on every echo"
    assert echo.Losses(config.LossesConfig(level=0.0), SETTING).size(echoes) == "0.0 dB on every echo"
    setting = setting_of(points=POINTS[:7])
    assert echo.Swerling(config.SwerlingConfig(case=1), setting).size(echoes) == "5.6 dB rms from frame to frame: 7 points"
    people = dataclasses.replace(setting, scene=dataclasses.replace(setting.scene, people=(Person(),)))
    everybody = echo.Swerling(config.SwerlingConfig(case=4, of="all"), people)
    assert everybody.size(echoes) == "3.5 dB rms from chirp to chirp: 7 points and 1 person"
    assert echo.Swerling(config.SwerlingConfig(case=4), SETTING).size(echoes) == "nothing in the scene fluctuates"
    assert echo.Swerling(config.SwerlingConfig(case=0), SETTING).size(echoes) == "steady (case 0)"


def test_size_of_swerling_is_the_spread():
    """Standard deviation of 10 log10 of the power."""
    for case, spread in ((1, 5.6), (3, 3.5)):
        factor = np.random.default_rng(2).chisquare(CHI_SQUARE[case], 200_000)
        assert np.std(10 * np.log10(factor)) == pytest.approx(spread, abs=0.06)


def test_size_of_multipath():
    """Floor at 1.2 m, target at 3 m and the radar's height: image at 3.84 m, -8.24 - 2.15 dB, half of 0.84 m behind its echo."""
    echoes = echoes_at([3.0, 0.0, 0.0])
    assert multipath.Multipath(config.MultipathConfig(), SETTING).size(echoes) == "strongest ghost -10.4 dB, 0.42 m behind its echo"
    with_ghosts = multipath.Multipath(config.MultipathConfig(), SETTING).process(echoes, MOMENT)
    assert multipath.Multipath(config.MultipathConfig(), SETTING).size(with_ghosts) == "strongest ghost -10.4 dB, 0.42 m behind its echo"
    assert multipath.Multipath(config.MultipathConfig(floor=0.0), SETTING).size(echoes) == "no floor or wall mirrors"


def test_size_of_clutter():
    """Its power against that of the echoes; ten times the cross-section are 10 dB."""
    echoes = echoes_at([3.0, 0.0, 0.0], rcs=1.0)
    levels = [number(sight.Clutter(config.ClutterConfig(rcs=r), SETTING).size(echoes).split(", ")[1]) for r in (1e-3, 1e-2)]
    assert levels[1] - levels[0] == pytest.approx(10.0, abs=0.11)
    drawn = sight.Clutter(config.ClutterConfig(rcs=1e-3), SETTING).scatterers
    distance = np.linalg.norm(drawn.motion.position - [0.0, 0.0, 1.2], axis=-1)
    assert levels[0] == pytest.approx(10 * math.log10((drawn.rcs / distance**4).sum() * 81), abs=0.06)


def test_sizes_of_physics():
    """Against closed forms and exact phases of one echo 1.5 m away, at 40 degrees, crossing and receding."""
    w = Waveform()
    place, velocity, acceleration = polar(40, 10, 1.5), np.array([1.0, -2.0, 0.5]), np.array([5.0, 0.0, 3.0])
    echoes = echoes_at(place, velocity, acceleration)
    rate = abs(float(place @ velocity)) / 1.5
    migrates, shifts = (number(physics.size(name, SETTING, echoes)) for name in ("range_migration", "doppler_in_chirp"))
    assert migrates == pytest.approx(rate * w.acquisition_time / w.range_resolution, rel=0.05)
    assert shifts == pytest.approx(2 * rate * w.carrier / SPEED_OF_LIGHT * 66e-6, rel=0.05)

    half = w.acquisition_time / 2
    distance = [np.linalg.norm(echoes.out.at(t)[0]) for t in (-half, 0.0, half)]
    off = 2 / w.wavelength * 360 * (distance[0] - 2 * distance[1] + distance[2]) / 2  # the even part: no third derivative
    assert number(physics.size("curvature", SETTING, echoes)) == pytest.approx(abs(off), rel=0.05)

    tx, rx = (np.array([[0.0, *e] for e in elements]) for elements in (AntennaArray().tx, AntennaArray().rx))
    u = place / 1.5
    squint = max(abs((t + r) @ u) for t in tx for r in rx) * w.bandwidth / 2 / SPEED_OF_LIGHT * 360
    assert number(physics.size("squint", SETTING, echoes)) == pytest.approx(squint, rel=0.05)
    near = [np.linalg.norm(place - t) + t @ u + np.linalg.norm(place - r) + r @ u - 3.0 for t in tx for r in rx]
    assert number(physics.size("near_field", SETTING, echoes)) == pytest.approx(max(near) / w.wavelength * 360, rel=0.05)


def test_sizes_of_physics_read_well():
    """Units, and digits that count."""
    echoes = echoes_at([2.0, 1.0, 0.0], (0.05, 0.0, 0.0))
    assert re.fullmatch(r"0\.00\d+ bins over a frame", physics.size("range_migration", SETTING, echoes))
    assert re.fullmatch(r"0\.00\d+ bins", physics.size("doppler_in_chirp", SETTING, echoes))
    assert re.fullmatch(r"[\d.]+ deg at the array's and sweep's ends", physics.size("squint", SETTING, echoes))
    assert re.fullmatch(r"[\d.]+ deg at the frame's ends", physics.size("curvature", SETTING, echoes))
    assert re.fullmatch(r"[\d.]+ deg at the array's ends", physics.size("near_field", SETTING, echoes))
    still = echoes_at([2.0, 0.0, 0.0])
    assert physics.size("range_migration", SETTING, still) == "0 bins over a frame"
    assert physics.size("squint", SETTING, still) == "0 deg at the array's and sweep's ends"


def test_a_tone_has_no_range_bins_and_no_sweep():
    """CW: nothing migrates or squints."""
    wave = Waveform(modulation="cw")
    radar = SceneRadar.of(RadarInfo(waveform=wave))
    setting = Setting(Scene(radars=(radar,)), radar)
    echoes = echoes_at([2.0, 1.0, 0.0], (3.0, 0.0, 0.0))
    assert physics.size("range_migration", setting, echoes) == "0 bins over a frame"
    assert physics.size("squint", setting, echoes) == "0 deg at the array's and sweep's ends"
