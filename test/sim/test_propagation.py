"""Models of propagation: the reference against (2.9) and (2.10) written out, the others against the reference."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import SPEED_OF_LIGHT, ConfigError, RadarInfo, Waveform
from radar_sim.propagation.base import NEAR, PHYSICS, Physics, Sampling
from radar_sim.propagation.blocks import WIDTH, Blocks, polynomials, window
from radar_sim.propagation.choose import DIAL, Auto, Sizes, Step, make_propagator, make_step, predicted
from radar_sim.propagation.exact import Exact
from radar_sim.propagation.kernels import cosine, jit, sine
from radar_sim.propagation.reference import Reference
from radar_sim.propagation.separable import Nufft, Separable
from radar_sim.scatterers import THING, Echoes, Motion
from radar_sim.scene import Fidelity

INFO = RadarInfo()
SMALL = RadarInfo(waveform=Waveform(n_chirp=12, n_sample=24, chirp_pause=500e-6))
"""As long a frame as the default, with fewer samples: what needs the reference stays quick."""
ODD = RadarInfo(waveform=Waveform(n_chirp=7, n_sample=13, chirp_pause=900e-6))
SIMPLE = Physics(doppler_in_chirp=True)
EACH = [Physics(), Physics.all(), *(Physics(**{name: True}) for name in PHYSICS)]
EACH += [Physics(range_migration=True, doppler_in_chirp=True), Physics(doppler_in_chirp=True, curvature=True)]
NAMES = ["none", "all", *PHYSICS, "migration+doppler", "doppler+curvature"]


def sampling(info: RadarInfo = SMALL) -> Sampling:
    return Sampling(info, np.asarray(info.array.tx, np.float64), np.asarray(info.array.rx, np.float64))


def of(out: Motion, back: Motion | None = None, strength=None, envelope=None) -> Echoes:
    n = len(out)
    strength = np.ones(n, np.complex128) if strength is None else np.asarray(strength, np.complex128)
    return Echoes(out, out if back is None else back, strength, np.full(n, THING, np.int32), np.arange(n, dtype=np.int32), envelope)


def crowd(n: int, seed: int = 0, speed: float = 3.0, acceleration: float = 20.0) -> Echoes:
    """Echoes as of gestures at 2 to 3 m: evenly distributed speeds, random directions, amplitudes and phases."""
    rng = np.random.default_rng(seed)

    def vectors(most: float) -> np.ndarray:
        direction = rng.standard_normal((n, 3))
        return direction * (rng.uniform(0, most, n) / np.linalg.norm(direction, axis=1))[:, None]

    azimuth, elevation = rng.uniform(-0.8, 0.8, n), rng.uniform(-0.4, 0.4, n)
    towards = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    motion = Motion(rng.uniform(2, 3, n)[:, None] * towards, vectors(speed), vectors(acceleration))
    return of(motion, strength=rng.rayleigh(1e-3, n) * np.exp(2j * np.pi * rng.random(n)))


def error(cube: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm(cube - truth) / np.linalg.norm(truth))


def mixed(info: RadarInfo, motion: Motion) -> np.ndarray:
    """Product of (2.9) and the conjugate of (2.10) for one point, from delays of every sample's own time, shape (tx, chirp, rx, sample).

    Both phases reach 1e7 rad, where float64 keeps 2e-9; they are taken in long double all the same.
    """
    w = info.waveform
    t, chirp = np.arange(w.n_tx), np.arange(w.n_chirp)
    fast = (np.arange(w.n_sample) / w.n_sample * w.chirp_duration).astype(np.longdouble)
    begin = (chirp * w.n_tx + t[:, None]) * w.chirp_interval
    since = begin[..., None] + fast - w.acquisition_time / 2
    place = motion.position[0] + since[..., None] * (motion.velocity[0] + since[..., None] * motion.acceleration[0] / 2)
    result = np.empty(info.cube_shape, np.complex128)
    f_min, k_r = np.longdouble(w.carrier - w.bandwidth / 2), np.longdouble(w.bandwidth / w.chirp_duration)

    def sent(time: np.ndarray) -> np.ndarray:
        return np.longdouble(np.pi) * k_r * time**2 + 2 * np.longdouble(np.pi) * f_min * time

    for i, (ty, tz) in enumerate(info.array.tx):
        for j, (ry, rz) in enumerate(info.array.rx):
            path = np.sqrt(((place[i] - [0, ty, tz]) ** 2).sum(-1)) + np.sqrt(((place[i] - [0, ry, rz]) ** 2).sum(-1))
            result[i, :, j] = np.exp(1j * (sent(fast) - sent(fast - path / SPEED_OF_LIGHT)).astype(np.float64))
    return result


@pytest.mark.parametrize(
    ("velocity", "acceleration"),
    [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((3.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((-2.0, 1.5, -0.7), (12.0, -9.0, 13.0))],
)
def test_reference_and_recurrence_are_the_mixed_product(velocity, acceleration):
    """Acceptance 4: to 1e-6 rad, sign included, for the reference; to 1e-3 rad for the phase recurrence; so for a point still or moving."""
    motion = Motion(*(np.array([x]) for x in ((2.1, 0.8, -0.4), velocity, acceleration)))
    truth = mixed(INFO, motion)
    sums = Reference(Physics.all(), sampling(INFO)).sums(of(motion))
    assert np.abs(np.angle(sums * truth.conj())).max() < 1e-6
    cube = Exact(Physics.all(), sampling(INFO)).process(of(motion))
    assert np.abs(np.angle(cube * truth.conj())).max() < 1e-3


def test_leaving_migration_out_costs_radians():
    """(2.11) omits migration: at 3 m/s the corner of a frame is off by 2 pi slope 2 v (T/2) (Tc/2) / c = 0.70 rad, and as much each side of
    four corners makes 2.8 rad from one to the opposite.
    """
    motion = Motion(np.array([[2.5, 0.0, 0.0]]), np.array([[3.0, 0.0, 0.0]]), np.zeros((1, 3)))
    full, none = (Reference(Physics(range_migration=m), sampling(INFO)).sums(of(motion)) for m in (True, False))
    turns = np.angle(full[0, :, 0] * none[0, :, 0].conj())
    across = turns[-1, -1] - turns[-1, 0] - turns[0, -1] + turns[0, 0]
    assert across == pytest.approx(2.8, abs=0.1)


@pytest.mark.parametrize("physics", EACH, ids=NAMES)
def test_exact_follows_each_physics(physics):
    """Exact keeps 2e-5 of the reference with every physics alone and with all: float32 recurrences, chords of 32 chirps."""
    echoes, late = crowd(12), np.random.default_rng(1).uniform(0, 50e-6, (12, 2))
    truth = Reference(physics, sampling()).sums(echoes, late)
    assert error(Exact(physics, sampling()).process(echoes, late), truth) < 2e-5


@pytest.mark.parametrize("physics", EACH, ids=NAMES)
def test_blocks_converge_for_each_physics(physics):
    """Errors fall with blocks and with order, to what the window (1e-5) and second derivatives within a block leave (5e-5 at twelve)."""
    echoes = crowd(12)
    truth = Reference(physics, sampling()).sums(echoes)
    rows = [[error(Blocks(physics, sampling(), b, o).process(echoes), truth) for o in (0, 1, 2)] for b in (1, 3, 12)]
    for row in rows:
        assert row[1] <= row[0] + 2e-5
        assert row[2] <= row[1] + 2e-5
    for few, many in pairwise(rows):
        assert all(b <= a + 2e-5 for a, b in zip(few, many, strict=True))
    assert rows[-1][2] < 5e-5


@pytest.mark.parametrize("physics", [Physics(), SIMPLE])
@pytest.mark.parametrize("info", [SMALL, ODD, INFO])
def test_models_agree_on_separable_physics(physics, info):
    """Separable to float32, the transforms to 5e-5 (finufft's tolerance 1e-5, the window's 1e-5), with even and odd numbers of samples."""
    echoes = crowd(10, seed=3)
    truth = Reference(physics, sampling(info)).sums(echoes)
    assert error(Separable(physics, sampling(info)).process(echoes), truth) < 2e-6
    for model in (Nufft(physics, sampling(info)), Blocks(physics, sampling(info), 2, 0), Exact(physics, sampling(info))):
        assert error(model.process(echoes), truth) < 5e-5


def test_separable_models_agree_on_thousands():
    """Chunks of echoes add up: 9,000 are three chunks of the product. The transform keeps 1e-4 of it, acceptance 1."""
    echoes = crowd(9000, seed=4)
    parts = [echoes.select(np.arange(k, k + 3000)) for k in (0, 3000, 6000)]
    model = Separable(SIMPLE, sampling())
    whole = model.process(echoes)
    assert error(whole, sum(model.process(part) for part in parts)) < 1e-6
    assert error(Nufft(SIMPLE, sampling()).process(echoes), whole) < 1e-4


def factors_in_numpy(echoes: Echoes, info: RadarInfo) -> np.ndarray:
    """The separable model's product in float64, from the formula in `radar_sim.propagation.base`."""
    w, s = info.waveform, sampling(info)
    legs = [(leg, np.linalg.norm(leg.position, axis=1)) for leg in (echoes.out, echoes.back)]
    path = sum(length for _, length in legs)
    rate = sum((leg.position * leg.velocity).sum(1) / length for leg, length in legs)
    out, back = (leg.position[:, 1:] / length[:, None] for leg, length in legs)
    slow = w.carrier / SPEED_OF_LIGHT * (rate * s.since[..., None] - (out @ s.tx.T).T)
    delay = path / SPEED_OF_LIGHT
    beat = (w.slope * delay + w.carrier / SPEED_OF_LIGHT * rate) * s.fast[:, None] + w.carrier * delay - w.slope * delay**2 / 2
    fast = beat - w.carrier / SPEED_OF_LIGHT * (back @ s.rx.T).T[:, None, :]
    volts = echoes.strength / (legs[0][1] * legs[1][1])
    return np.einsum("ltn,rkn,n->tlrk", np.exp(2j * np.pi * slow), np.exp(2j * np.pi * fast), volts)


def test_kernel_of_the_factors_is_its_formula():
    """Compiled polynomials against numpy's exponential: float32."""
    assert error(Separable(SIMPLE, sampling()).process(crowd(40)), factors_in_numpy(crowd(40), SMALL)) < 2e-6


def recurrence_in_numpy(echoes: Echoes, info: RadarInfo) -> np.ndarray:
    """What `radar_sim.propagation.exact` computes with all physics, in float64: a parabola of phase per chirp, by differences of time."""
    w, s = info.waveform, sampling(info)
    k = np.arange(w.n_sample) - w.n_sample / 2
    cube = np.zeros(info.cube_shape, np.complex128)
    for j in range(len(echoes)):
        one = echoes.select(np.array([j]))
        h = w.chirp_duration / 4
        delays = [_delays(one, s, s.since + x) for x in (-h, 0.0, h)]
        tau, rate, bend = delays[1], (delays[2] - delays[0]) / (2 * h), (delays[2] - 2 * delays[1] + delays[0]) / h**2
        step = w.chirp_duration / w.n_sample
        t0 = w.carrier * tau - w.slope * tau**2 / 2
        t1 = step * (w.slope * tau + w.carrier * rate - w.slope * tau * rate)
        t2 = step**2 * (w.carrier * bend / 2 + w.slope * rate)
        phase = t0[..., None] + t1[..., None] * k + t2[..., None] * k**2
        length = np.linalg.norm(
            one.out.position[0] + s.since[..., None] * (one.out.velocity[0] + s.since[..., None] * one.out.acceleration[0] / 2), axis=-1
        )
        cube += (one.strength[0] / length[..., None, None] ** 2 * np.exp(2j * np.pi * phase)).transpose(1, 0, 2, 3)
    return cube


def _delays(one: Echoes, s: Sampling, time: np.ndarray) -> np.ndarray:
    """Delays of one echo, shape (chirp, tx, rx) [s]."""
    place = one.out.position[0] + time[..., None] * (one.out.velocity[0] + time[..., None] * one.out.acceleration[0] / 2)
    tx, rx = (np.insert(x, 0, 0.0, axis=1) for x in (s.tx, s.rx))
    out = np.linalg.norm(place - tx, axis=-1)[..., None]
    return (out + np.linalg.norm(place[:, :, None, :] - rx, axis=-1)) / SPEED_OF_LIGHT


def test_kernel_of_the_recurrence_is_its_formula():
    """The same parabola in float64: float32's recurrence keeps 1e-5 of it, second derivatives by differences 1e-6."""
    echoes = crowd(6)
    assert error(Exact(Physics.all(), sampling()).process(echoes), recurrence_in_numpy(echoes, SMALL)) < 2e-5


def test_polynomial_sines():
    """Compiled sine and cosine of half a turn to either side: float32 rounds by 6e-7."""

    @jit
    def both(x, c, s):
        for i in range(x.size):
            c[i], s[i] = cosine(x[i]), sine(x[i])

    x = np.linspace(-0.5, 0.5, 20001, dtype=np.float32)
    c, s = np.empty_like(x), np.empty_like(x)
    both(x, c, s)
    np.testing.assert_allclose(c, np.cos(2 * np.pi * x.astype(np.float64)), atol=8e-7)
    np.testing.assert_allclose(s, np.sin(2 * np.pi * x.astype(np.float64)), atol=8e-7)


def test_window_polynomials():
    """They are the window and, with respect to the tone's place, its derivatives; differences over 1e-3 cells leave 1e-5."""
    u, cells = np.linspace(0.01, 0.99, 99)[:, None], np.arange(WIDTH) - WIDTH / 2
    values = [np.stack([np.polyval(p.astype(np.float64), u[:, 0]) for p in rows], 1) for rows in polynomials()]
    h = 1e-3
    below, here, above = (window(u + cells - d) for d in (-h, 0.0, h))
    np.testing.assert_allclose(values[0], here, atol=1e-6)
    inside = slice(1, -1)  # the window ends with a small step, over which there is no difference to take
    np.testing.assert_allclose(values[1][:, inside], ((above - below) / (2 * h))[:, inside], atol=2e-5)
    np.testing.assert_allclose(values[2][:, inside], ((above - 2 * here + below) / h**2)[:, inside], atol=2e-4)


@pytest.mark.parametrize("model", ["separable", "nufft", "blocks", "exact"])
def test_legs_that_differ(model):
    """An echo that goes straight and comes back by a mirror: transmitters see one place, receivers the other."""
    physics = SIMPLE if model in ("separable", "nufft") else Physics.all()
    out, back = crowd(8, seed=5).out, crowd(8, seed=6).out
    echoes = of(out, back, strength=np.exp(1j * np.arange(8)))
    truth = Reference(physics, sampling()).sums(echoes)
    assert error(make_step(Step(model, 6, 2), physics, sampling()).process(echoes), truth) < 2e-4
    swapped = Reference(physics, sampling()).sums(of(back, out, strength=echoes.strength))
    assert error(swapped, truth) > 0.1


@pytest.mark.parametrize("model", ["separable", "nufft", "blocks", "exact"])
def test_envelope_and_late_chirps(model):
    """Amplitudes of chirps and their lateness are the reference's; the transform leaves both to the product, number by number."""
    physics, rng = (SIMPLE if model in ("separable", "nufft") else Physics.all()), np.random.default_rng(7)
    echoes = dataclasses.replace(crowd(8), envelope=rng.uniform(0, 2, (12, 2, 8)).astype(np.float32))
    late = rng.uniform(0, 400e-6, (12, 2))
    propagator = make_step(Step(model, 6, 2), physics, sampling())
    cube = propagator.process(echoes, late)
    assert error(cube, Reference(physics, sampling()).sums(echoes, late)) < 2e-4
    if model == "nufft":
        np.testing.assert_array_equal(cube, Separable(physics, sampling()).process(echoes, late))
        plain = crowd(8)
        np.testing.assert_array_equal(propagator.process(plain, late), Separable(physics, sampling()).process(plain, late))


@pytest.mark.parametrize("step", DIAL, ids=str)
def test_frames_do_not_depend_on_what_was_before(step):
    """Plans and scratch are used again: the same echoes give the same bytes, and a frame that was handed out stays as it is."""
    info = RadarInfo(waveform=Waveform(n_chirp=4, n_sample=8))
    propagator = make_step(step, SIMPLE, sampling(info))
    first = propagator.process(crowd(5))
    kept = first.copy()
    propagator.process(crowd(9, seed=2))
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(propagator.process(crowd(5)), kept)
    assert first.dtype == np.complex64
    assert first.shape == info.cube_shape


def test_phase_and_amplitude_of_the_strength():
    """Amplitude is abs(strength) over both legs; the strength's phase adds to the echo's."""
    motion = Motion.still(np.array([[3.0, 0.0, 0.0]]))
    physics = Physics()
    plain, turned = (Separable(physics, sampling()).process(of(motion, strength=[s])) for s in (4.5, 4.5 * np.exp(0.7j)))
    np.testing.assert_allclose(np.abs(plain), 0.5, rtol=1e-6)
    np.testing.assert_allclose(np.angle(turned * plain.conj()), 0.7, atol=1e-5)


def test_true_places_of_elements_count():
    """Steering follows sampling.tx and sampling.rx, not the array as drawn: 0.1 mm is 0.026 turns at the side."""
    moved = dataclasses.replace(sampling(), rx=sampling().rx + np.array([[0, 0], [1e-4, 0], [0, 0], [0, 0]]))
    motion = Motion.still(np.array([[2.0, 2.0, 0.0]]))
    for physics in (Physics(), Physics.all()):
        a, b = (Exact(physics, s).process(of(motion)) for s in (sampling(), moved))
        turned = np.angle((b * a.conj()).sum(axis=(0, 1, 3))) / (2 * np.pi)
        np.testing.assert_allclose(turned, [0, -1e-4 * math.sqrt(0.5) / INFO.waveform.wavelength, 0, 0], atol=2e-5)


@pytest.mark.parametrize("model", ["separable", "nufft"])
def test_separable_models_refuse_other_physics(model):
    """They say what they cannot show, and what to choose instead; Doppler within the chirp they can."""
    make_propagator(Fidelity(model=model), SIMPLE, sampling(), 0.02)
    for name in ("range_migration", "squint", "curvature", "near_field"):
        with pytest.raises(ConfigError, match=rf"{model}.*{name}.*choose blocks or exact"):
            make_propagator(Fidelity(model=model), Physics(**{name: True}), sampling(), 0.02)


def test_more_blocks_than_chirps():
    with pytest.raises(ConfigError, match=r"fidelity\.blocks is 13, but a frame has 12 chirps"):
        make_propagator(Fidelity(model="blocks", blocks=13), Physics(), sampling(), 0.02)


@settings(max_examples=12, deadline=None)
@given(
    speed=st.floats(0.0, 5.0),
    acceleration=st.floats(0.0, 30.0),
    step=st.sampled_from([*DIAL[:1], Step("blocks", 1, 0), Step("blocks", 4, 0), Step("blocks", 2, 1), *DIAL[2:6]]),
    flags=st.tuples(*[st.booleans()] * 5),
)
def test_predictions_hold(speed, acceleration, step, flags):
    """What auto goes by is the error within a factor of two upwards (40 echoes are a small sample of phases), three downwards (bounds)."""
    physics, simple = Physics(*flags), step.model == "separable"
    echoes = crowd(40, seed=8, speed=speed, acceleration=acceleration)
    truth = Exact(physics, sampling()).process(echoes).astype(np.complex128)
    model = make_step(step, Physics(doppler_in_chirp=physics.doppler_in_chirp) if simple else physics, sampling())
    found, said = error(model.process(echoes), truth), predicted(step, Sizes.of(echoes, sampling()), physics, sampling())
    assert found < 2 * said + 3e-5
    assert said < 3 * found + 2e-4


@pytest.mark.parametrize("n", [3, 60, 700])
@pytest.mark.parametrize("tolerance", [0.3, 0.02, 1e-3, 1e-4, 1e-6])
def test_auto_meets_the_tolerance_with_no_more_than_it_takes(n, tolerance):
    """The choice is within tolerance (by the reference or what is near it), and a looser tolerance never costs more."""
    from radar_sim.propagation.choose import cost

    info = RadarInfo(waveform=Waveform(n_chirp=12, n_sample=16, chirp_pause=500e-6))
    echoes, s = crowd(n, seed=9), sampling(info)
    auto = Auto(Physics.all(), s, tolerance)
    truth = (Reference if n < 100 else Exact)(Physics.all(), s).process(echoes)
    if not (n >= 100 and tolerance < 1e-5):
        assert error(auto.process(echoes), truth) < 1.3 * tolerance + 2e-7
    assert cost(auto.choose(echoes), n, s) >= cost(Auto(Physics.all(), s, 3 * tolerance).choose(echoes), n, s)


def test_auto_without_physics_takes_product_or_transform():
    """Few echoes: the product; many: the transform, which cannot do late chirps and amplitudes that vary: blocks then."""
    auto = Auto(SIMPLE, sampling(INFO), 0.02)
    assert auto.choose(crowd(50)).model == "separable"
    many = crowd(3000)
    assert auto.choose(many).model == "nufft"
    assert auto.choose(many, np.zeros((64, 2))).model == "blocks"
    assert auto.choose(dataclasses.replace(many, envelope=np.ones((64, 2, 3000), np.float32))).model == "blocks"
    np.testing.assert_array_equal(auto.process(many), Nufft(SIMPLE, sampling(INFO)).process(many))


def test_near_echoes_stop_rising():
    """Nearer than NEAR the radar equation has no meaning: amplitudes are those at NEAR, in every model."""
    echoes = of(Motion.still(np.array([[0.01, 0.0, 0.0]])))
    for step in DIAL:
        cube = make_step(step, SIMPLE, sampling()).process(echoes)
        np.testing.assert_allclose(np.abs(cube), 1 / NEAR**2, rtol=1e-3)
