"""The doctor's measurements against the truth of made-up frames, clouds, tracks and stamps."""

import dataclasses

import numpy as np
import pytest

from radar_core import PointCloud, Pose, Quality, RadarFrame, RadarInfo
from radar_lab.doctor import echoes, links, samples
from radar_lab.doctor import mount as mount_check
from radar_lab.doctor.bursts import Bursts
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.examine import examine
from radar_lab.doctor.finding import SYMPTOMS, Finding, in_order
from radar_lab.doctor.heaps import windows
from radar_lab.doctor.people import follow
from radar_lab.doctor.tuning import Tuning
from radar_tracking.tracks import Deleted, Reason, Track, Tracks, TrackStatus

INFO = RadarInfo()
INTERVAL = 50_000_000  # ns
START = 1_700_000_000_000_000_000


def cloud(k, x, y, speed, snr=30.0, **more):
    """Points at places with range rates, as the radar at the origin measures them."""
    x, y, speed = (np.atleast_1d(np.asarray(a, np.float32)) for a in (x, y, speed))
    snr = np.broadcast_to(np.float32(snr), x.shape).astype(np.float32)
    polar = {"range": np.hypot(x, y), "azimuth": np.arctan2(y, x).astype(np.float32)}
    return PointCloud(START + k * INTERVAL, k, "radar", x, y, np.zeros_like(x), radial_speed=speed, snr=snr, **polar, **more)


def walk(n=200, x=2.0, v=1.0, y=0.0, **more):
    """Five points of somebody who walks to and fro along x, within a metre and a half."""
    rng = np.random.default_rng(3)
    clouds, way = [], 1.0
    for k in range(n):
        x += way * v * INTERVAL * 1e-9
        clouds.append(cloud(k, x + rng.normal(0, 0.05, 5), y + rng.normal(0, 0.05, 5), way * v + rng.normal(0, 0.1, 5), **more))
        way = -way if not 1.5 < x + way * 0.05 < 4.5 else way
    return clouds


def track(number, x, y, status=TrackStatus.CONFIRMED):
    """Somebody who is followed."""
    return Track(number, status, 1.0, 0.0, 3, np.array([x, y, 1.0]), np.zeros(3), np.zeros(3), np.eye(6))


def tracks(of, *people, deleted=()):
    """Tracks of a cloud."""
    return Tracks(of.stamp_ns, of.sequence, "room", people, np.full(len(of), -1, np.int32), deleted)


def middle(of):
    """Where the points of a cloud are."""
    return float(of.x.mean()), float(of.y.mean())


def evidence(clouds, arrays=(), info=INFO):
    """A radar that gave these clouds and tracks."""
    found = Evidence(info)
    for one in clouds:
        found.cloud(one, one.stamp_ns + 5_000_000 + one.sequence % 7 * 1000)
    for one in arrays:
        found.track(one, None)
    return found


def test_bursts_are_counted_and_walkers_are_none():
    """Of noise, and of an echo that moves, no sample counts; of those in which another radar is heard, all."""
    rng = np.random.default_rng(1)
    noise = (rng.normal(size=(2, 64, 4, 64, 2)) @ [1, 1j]).astype(np.complex64)
    turn = np.exp(1j * (0.7 * np.arange(64)[:, None, None] + 0.9 * np.arange(64)))
    clean, disturbed = Bursts(), Bursts()
    clean.add(noise + 50 * turn)
    noise[0, 10, :, 20:28] += 300
    disturbed.add(noise)
    assert clean.share == 0.0
    assert disturbed.share == pytest.approx(24 / (2 * 62 * 64), rel=0.01)  # three second differences see each of the eight samples


@pytest.mark.parametrize(("kept", "fault"), [(lambda k: True, False), (lambda k: k % 10 != 3, True), (lambda k: k != 57, False)])
def test_losses(kept, fault):
    """A tenth of the clouds is a fault, one of two hundred is not."""
    finding = links.drops(evidence([c for c in walk() if kept(c.sequence)]))
    assert finding.fault is fault
    assert finding.value == pytest.approx(np.mean([not kept(k) for k in range(200)]), abs=1e-9)


def test_what_the_doctor_itself_misses_of_a_running_graph_is_no_fault():
    """There the stages say what they lost; without them, gaps are counted as in a recording."""
    found = evidence([c for c in walk() if c.sequence % 3])
    found.live = True
    assert links.drops(found).fault
    for count in (0, 200):
        found.stage("tracking", count, 0)
    assert not links.drops(found).fault


def test_a_stage_that_drops_is_named_with_its_budget():
    """The stage that lost most is the one to relieve, unless a stage before it loses too."""
    found = evidence(walk())
    for count in (0, 50):
        found.stage("driver", count * 2, 0)
        found.stage("tracking", count, count // 2)
    finding = links.drops(found)
    assert finding.fault
    assert "tracking" in finding.text
    assert "--param tracking.frame_budget_ms=10" in finding.remedy


@pytest.mark.parametrize(("ahead", "fault"), [(0.0, False), (0.02, True), (-0.3, False), (-5.0, True)])
def test_stamps_ahead_of_their_arrival(ahead, fault):
    """Nothing arrives before it was measured, nor seconds later."""
    found = Evidence(INFO)
    for one in walk():
        found.cloud(dataclasses.replace(one, stamp_ns=one.stamp_ns + round(ahead * 1e9)), one.stamp_ns + 8_000_000 + one.sequence)
    finding = links.clock(found)
    assert finding.fault is fault
    assert finding.value == pytest.approx(8 - ahead * 1e3, abs=0.01)


def test_simulated_clocks_are_not_compared():
    """Where arrivals are stamps, nothing can be said."""
    found = Evidence(INFO)
    for one in walk():
        found.cloud(one, one.stamp_ns)
    assert links.clock(found).fault is None


def test_two_radars_whose_clocks_disagree():
    """The offset is found to a millisecond; the same clock is no fault."""
    rng = np.random.default_rng(5)
    for offset, fault in ((30, True), (-30, True), (0, False)):
        left, right = Evidence(INFO, "left"), Evidence(INFO, "right")
        for one in walk():
            for radar, ahead in ((left, 0), (right, offset)):
                late = 4_000_000 + int(rng.exponential(1e6))
                radar.cloud(dataclasses.replace(one, stamp_ns=one.stamp_ns + ahead * 1_000_000), one.stamp_ns + late)
        (finding,) = links.clocks([left, right])
        assert finding.fault is fault
        assert finding.value == pytest.approx(offset, abs=1.0)


def test_reach_by_the_strength_of_an_echo():
    """Power falls with the fourth power of the range: 15 dB at 2 m, though somebody walks nearer and farther."""
    clouds = [dataclasses.replace(c, snr=(15 - 40 * np.log10(c.range / 2.0)).astype(np.float32)) for c in walk()]
    finding = echoes.low_snr(evidence(clouds))
    assert finding.fault
    assert finding.value == pytest.approx(2.0, rel=0.05)
    assert not echoes.low_snr(evidence(walk())).fault


@pytest.mark.parametrize(("limit", "share"), [(4.2, 0.0), (0.8, 1.0)])
def test_folded_speed(limit, share):
    """Somebody walks with 1.3 m/s: a radar that tells 0.8 m/s folds it."""
    wave = INFO.waveform
    pause = wave.wavelength / (4 * limit * wave.n_tx) - wave.chirp_duration
    info = dataclasses.replace(INFO, waveform=dataclasses.replace(wave, chirp_pause=pause, n_chirp=16, frame_interval=0.05))
    clouds = [dataclasses.replace(c, radial_speed=(c.radial_speed + limit) % (2 * limit) - limit) for c in walk(v=1.3)]
    finding = echoes.aliased(evidence(clouds, info=info))
    assert finding.value == pytest.approx(share, abs=0.2)  # but for the half seconds in which they turn
    assert finding.fault is (share > 0.5)
    assert ("baseband.tdm.unfold=true" in finding.remedy) is (share > 0.5)


def test_heaps_are_what_moves():
    """Two walkers 1.5 m apart are two heaps in every half second, furniture and single false alarms none."""
    rng = np.random.default_rng(2)
    both = [
        cloud(
            a.sequence,
            [*a.x, *b.x, 3.0, rng.uniform(1, 5)],
            [*a.y, *b.y, 1.5, rng.uniform(-2, 2)],
            [*a.radial_speed, *b.radial_speed, 0.0, 3.0],
        )
        for a, b in zip(walk(), walk(y=1.5, x=2.4), strict=True)
    ]
    cut = windows(both)
    assert len(cut) == 20
    assert all(len(window.heaps) == 2 for window in cut)


def test_followed_lost_and_ghosts():
    """Who is followed is; who is lost while standing and found again is counted; furniture and a fan are ghosts."""
    clouds = walk()
    good = follow([(c, tracks(c, track(1, *middle(c)))) for c in clouds], Pose())
    assert good.unfollowed_share == 0.0
    assert not good.lost
    assert not good.ghosts
    assert follow([(c, tracks(c)) for c in clouds], Pose()).unfollowed_share == 1.0
    still = [(c, tracks(c, track(1, *middle(c)), track(2, 3.0, 2.5))) for c in clouds]
    ghost = follow(still, Pose())
    assert [(life.number, life.ghost) for life in ghost.ghosts] == [(2, "still")]
    assert ghost.ghost_share == pytest.approx(1.0)
    fan = [cloud(c.sequence, [*c.x, 3.0], [*c.y, 2.5], [*c.radial_speed, 0.9]) for c in clouds]
    spins = follow([(c, tracks(c, track(1, *middle(walker)), track(2, 3.0, 2.5))) for c, walker in zip(fan, clouds, strict=True)], Pose())
    assert [(life.number, life.ghost) for life in spins.ghosts] == [(2, "spins")]


def test_lost_while_standing():
    """A track that ends at the place where the next one begins was of one person; tried on the clouds, a longer life cures it."""
    moving = walk(60)
    last = middle(moving[-1])
    rests = [cloud(60 + k, [last[0]] * 4, [last[1]] * 4, [0.0] * 4) for k in range(80)]
    later = [dataclasses.replace(c, stamp_ns=c.stamp_ns + 140 * INTERVAL, sequence=c.sequence + 140) for c in walk(60, x=last[0])]
    arrays = [tracks(c, track(1, *middle(c))) for c in moving]
    arrays += [tracks(rests[0], deleted=(Deleted(1, Reason.UNSEEN, True),)), *(tracks(c) for c in rests[1:])]
    arrays += [tracks(c, track(2, *middle(c))) for c in later]
    tuning = Tuning(evidence([*moving, *rests, *later], arrays))
    (old, new) = tuning.followed.lost[0]
    assert (old.number, new.number) == (1, 2)
    finding = next(one for one in tuning.findings() if one.symptom == "lost when still")
    assert finding.fault
    assert "tracking.poisson.stay_time=" in finding.remedy
    removed = [dataclasses.replace(c, quality=Quality.STATIC_REMOVED) for c in (*moving, *rests, *later)]
    finding = next(one for one in Tuning(evidence(removed, arrays)).findings() if one.symptom == "lost when still")
    assert "--param baseband.spectrum.static=keep" in finding.remedy


def test_two_in_one_track():
    """Two people a metre apart with one track between them are merged; a track each is well."""
    both = [
        cloud(a.sequence, [*a.x, *b.x], [*a.y, *b.y], [*a.radial_speed, *b.radial_speed])
        for a, b in zip(walk(y=-0.5), walk(y=0.5), strict=True)
    ]
    one = Tuning(evidence(both, [tracks(c, track(1, *middle(c))) for c in both]))
    two = Tuning(evidence(both, [tracks(c, track(1, middle(c)[0], -0.5), track(2, middle(c)[0], 0.5)) for c in both]))
    merged, apart = (next(f for f in tuning.findings() if f.symptom == "merged people") for tuning in (one, two))
    assert merged.value > 0.8
    assert merged.fault
    assert "--param tracking." in merged.remedy
    assert apart.value < 0.05
    assert not apart.fault


def test_nobody_found_names_settings_that_find_somebody():
    """One point a cloud is too little for the thesis's trackers, not for the default; the remedy was tried, and is loadable."""
    thin = [cloud(c.sequence, c.x[:1], c.y[:1], c.radial_speed[:1]) for c in walk()]
    seen = evidence(thin, [tracks(c) for c in thin])
    thesis, usual = (
        next(f for f in Tuning(seen, given).findings() if f.symptom == "nobody found") for given in ({"tracker": "group_clustering"}, {})
    )
    assert thesis.fault
    assert usual.fault
    assert "with the defaults it is well on this recording" in usual.remedy
    assert "--param tracking.tracker=poisson_bernoulli" in usual.remedy
    assert "with the defaults it is well on this recording" in thesis.remedy


def test_saturation_of_samples_and_of_clouds():
    """Samples at the limit are counted; without frames, the clouds' flags are."""
    info = dataclasses.replace(INFO, full_scale=2047.0)
    found = Evidence(info)
    cube = np.zeros(info.cube_shape, np.complex64)
    cube[0, 0, 0, :8] = 2047
    found.frame(RadarFrame(cube, START, 0, "radar"), START)
    assert samples.saturation(found).value == pytest.approx(8 / cube.size)
    assert not samples.saturation(found).fault
    flagged = [dataclasses.replace(c, quality=Quality.SATURATED) for c in walk(20)]
    assert samples.saturation(evidence(flagged, info=info)).fault
    assert samples.saturation(evidence(walk(20))).fault is None


def test_the_order_is_that_of_the_signal():
    """Faults come first, what spoils the others before them; healthy and unknown ones follow."""
    rng = np.random.default_rng(4)
    known = [Finding(symptom, bool(k % 2) if k % 3 else None, None, None, "", "") for k, symptom in enumerate(SYMPTOMS)]
    ordered = in_order([known[k] for k in rng.permutation(len(known))])
    assert [f.fault for f in ordered] == sorted((f.fault for f in known), key=[True, False, None].index)
    faults = [SYMPTOMS.index(f.symptom) for f in ordered if f.fault]
    assert faults == sorted(faults)


def test_nothing_that_moves_is_no_fault():
    """An empty room is healthy, and what could not be measured says what to do."""
    empty = [cloud(k, [], [], []) for k in range(100)]
    found = examine([evidence(empty, [tracks(c) for c in empty])])
    assert not any(one.fault for one in found)
    assert "let somebody walk" in next(one.text for one in found if one.symptom == "nobody found")


def test_frames_of_another_radar_are_named():
    """Messages that had to be refused are a fault, with the first reason."""
    found = evidence(walk())
    found.refuse("frame 3 has shape (1, 2, 3, 4)")
    first = examine([found])[0]
    assert (first.symptom, first.fault) == ("unusable data", True)
    assert "frame 3 has shape" in first.text


@pytest.mark.parametrize(("given", "fault"), [(-0.3, False), (-0.2, False), (0.05, True), (0.0, True), (-0.6, True)])
def test_a_tilt_that_puts_people_elsewhere(given, fault):
    """Somebody a metre high before a radar that is tilted down by 0.3 rad, and says another tilt; the remedy names the true one."""
    mount, rng = Pose(z=1.3, tilt=-0.3), np.random.default_rng(4)
    c, s = np.cos(mount.tilt), np.sin(mount.tilt)
    found = Evidence(dataclasses.replace(INFO, mount=dataclasses.replace(mount, tilt=given)))
    for k in range(200):
        x, y, z = 3.0 + np.sin(0.05 * k), rng.normal(0, 0.2, 5), 1.0 - mount.z + rng.normal(0, 0.3, 5)
        ahead, up = (c * x + s * z).astype(np.float32), (c * z - s * x).astype(np.float32)
        distance = np.sqrt(ahead**2 + y**2 + up**2).astype(np.float32)
        one = cloud(k, ahead, y, np.ones(5))
        polar = {"range": distance, "azimuth": np.arctan2(y, ahead).astype(np.float32), "elevation": np.arcsin(up / distance)}
        found.cloud(dataclasses.replace(one, z=up, **polar), one.stamp_ns)
    finding = mount_check.tilted(found)
    assert finding.fault is fault, finding.text
    if fault:
        assert abs(float(finding.remedy.split()[-2]) + 0.3) < 0.1
    flat = dataclasses.replace(one, elevation=np.full(5, np.nan, np.float32), z=np.full(5, np.nan, np.float32))
    assert mount_check.tilted(evidence([flat])).fault is None
