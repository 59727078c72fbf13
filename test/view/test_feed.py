"""The feed: bounded, in order, frozen for readers, and free of ROS and of Bokeh."""

import subprocess
import sys
import threading

import numpy as np
import pytest

from radar_app.view.feed import Feed
from radar_app.view.table_panels import Latencies
from radar_app.watching.reports import StageReport
from radar_core import PointCloud
from radar_tracking.tracks import Track, Tracks, TrackStatus

SECOND = 1_000_000_000


def cloud(number, stamp_ns, n=3):
    return PointCloud(stamp_ns, number, "room", *np.zeros((3, n), np.float32))


def tracks(number, stamp_ns, *ids, status=TrackStatus.CONFIRMED):
    made = tuple(Track(i, status, 1.0, 0.0, 3, np.zeros(3), np.zeros(3), np.zeros(3), np.eye(6)) for i in ids)
    return Tracks(stamp_ns, number, "room", made, np.zeros(3, np.int32))


def fill(feed, seconds, rate=10, start=0.0):
    for k in range(round(seconds * rate)):
        stamp = round((start + k / rate) * SECOND)
        feed.put("clouds", stamp, cloud(k, stamp))
        feed.put("tracks", stamp, tracks(k, stamp, 1))


def test_only_the_last_minute_is_kept():
    """Older entries go; raw frames go after some seconds."""
    feed = Feed(keep=60.0)
    fill(feed, 90.0)
    history = feed.history()
    assert history.end_ns - history.start_ns <= 60 * SECOND
    assert history.end_ns - history.start_ns > 59 * SECOND
    for k in range(200):
        feed.put("frames", k * SECOND // 10, object())
    assert len(feed.history().frames) == 61


def test_a_history_does_not_change_any_more():
    """Who has one may look through it while more comes."""
    feed = Feed()
    fill(feed, 5.0)
    frozen = feed.history()
    count, end = len(frozen.clouds), frozen.end_ns
    fill(feed, 30.0, start=5.0)
    assert (len(frozen.clouds), frozen.end_ns) == (count, end)
    with pytest.raises(AttributeError):
        frozen.number = 3


def test_a_moment_shows_what_was_known_then():
    """Tracks with their own cloud, and nothing of later."""
    feed = Feed()
    fill(feed, 10.0)
    now = feed.history().at(4 * SECOND)
    assert now.tracks.stamp_ns == now.cloud.stamp_ns == 4 * SECOND
    assert feed.history().at().tracks.stamp_ns == feed.history().end_ns


def test_tracks_are_shown_with_their_cloud():
    """Tracks that came before their cloud wait for it; where there are no clouds at all they do not."""
    feed = Feed()
    fill(feed, 1.0)
    feed.put("tracks", SECOND, tracks(10, SECOND, 1))
    assert feed.history().at().tracks.sequence == feed.history().at().cloud.sequence == 9
    bare = Feed()
    bare.put("tracks", SECOND, tracks(10, SECOND, 1))
    assert bare.history().at().tracks.sequence == 10
    assert bare.history().at().cloud is None


def test_tentative_tracks_are_no_people():
    """As in the count of people."""
    feed = Feed()
    feed.put("tracks", 0, tracks(0, 0, 1, 2, status=TrackStatus.TENTATIVE))
    assert feed.history().at().people.tracks == ()


def test_time_that_goes_back_is_another_recording():
    """Everything before it is forgotten; what is only late is not."""
    feed = Feed()
    fill(feed, 20.0)
    feed.put("clouds", 19 * SECOND + SECOND // 2, cloud(1000, 0))
    assert len(feed.history().clouds) == 201
    feed.put("tracks", 0, tracks(0, 0, 1))
    assert len(feed.history().tracks) == 1
    assert not feed.history().clouds


@pytest.mark.parametrize("clocked", [True, False], ids=["with_clouds", "without"])
def test_a_stamp_of_tomorrow_keeps_nothing_for_ever(clocked):
    """One report from the future does not stop others from growing old, and those of now are there at once."""
    feed = Feed(keep=10.0)
    for k in range(300):
        stamp = k * SECOND // 10
        if clocked:
            feed.put("clouds", stamp, cloud(k, stamp))
        feed.put("health", stamp + (86400 * SECOND if k == 50 else 0), k)
    kept = [entry.value for entry in feed.history().health]
    assert kept == list(range(199, 300))
    assert [entry.value for entry in feed.history().at().past("health", 1.0)][-5:] == list(range(295, 300))


def test_after_misses_nothing_and_gives_nothing_twice():
    """A reader in another thread that asks again and again gets every entry once, in order."""
    feed, got, seen = Feed(), [], 0
    writer = threading.Thread(target=fill, args=(feed, 50.0))
    writer.start()
    while writer.is_alive() or feed.after("clouds", seen):
        for entry in feed.after("clouds", seen):
            got.append(entry.value.sequence)
            seen = entry.number
    writer.join()
    assert got == list(range(500))


def test_wait_tells_that_something_came():
    """And that nothing did."""
    feed = Feed()
    assert not feed.wait(0, 0.01)
    fill(feed, 0.1)
    assert feed.wait(0, 0.0)
    assert not feed.wait(feed.number, 0.01)


def test_wishes_are_counted():
    """Two may want the same; it is wanted until the second has enough."""
    feed = Feed()
    with feed.want("frames"):
        with feed.want("frames"):
            pass
        assert feed.wanted("frames")
    assert not feed.wanted("frames")


def test_figures_of_stages():
    """Rate, time and latency of the last two seconds, by the reports of the driver, however many come together."""
    feed = Feed()
    for k in range(150):
        stamp = k * SECOND // 50
        feed.put("tracks", stamp, tracks(k, stamp, 1))
        if k % 10 == 4:  # some together, and of the last five nothing yet
            for name, dropped, compute, late in (("tracking", 3, 0.004, 7_000_000), ("driver", 0, 0.001, 0)):
                for number in range(max(k - 9, 0), k + 1):
                    at = number * SECOND // 50
                    feed.put("status", at, StageReport(name, number, number + 1, dropped, compute, at + late, False, at))
    tracking, driver = feed.history().at().stages
    assert tracking.rate == pytest.approx(50.0)
    assert tracking.latency == pytest.approx(0.007)
    assert tracking.compute == pytest.approx(0.004)
    assert (tracking.dropped, driver.latency) == (3, 0.0)
    feed.put("status", 3 * SECOND, StageReport("tracking", 149, 150, 3, 0.0, 0, True, 3 * SECOND))
    assert feed.history().at().stages[0].stale


def test_latencies_of_radars_that_report_one_after_the_other():
    """A fused result counts from the frame that was published first, also if the report of that frame comes last."""
    feed, known = Feed(), Latencies()
    for k in range(100):
        stamp = k * SECOND // 20
        feed.put("tracks", stamp, tracks(k, stamp, 1))
        if k % 4 == 3:
            for name, late in (("tracking", 30), ("right/driver", 10), ("left/driver", 0)):
                for number in range(k - 3, k + 1):
                    at = number * SECOND // 20
                    feed.put("status", at, StageReport(name, number, number + 1, 0, 0.001, at + late * 1_000_000, False, at))
                known.until(feed.history().at())  # somebody looks all the time
    found = known.until(feed.history().at())
    assert [each.stamp_ns for each in found] == [k * SECOND // 20 for k in range(100)]
    assert {each.late_ns for each in found} == {30_000_000}


def test_the_feed_knows_neither_ros_nor_bokeh():
    """So that a logger, or an application, can use it alone."""
    code = "import sys, radar_app.view.feed, radar_app.view.maps, radar_app.view.spectra; print({'rclpy', 'bokeh'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
