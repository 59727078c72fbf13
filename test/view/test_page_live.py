"""The page over a running graph of real nodes, in a real browser."""

import subprocess
import sys
import threading

import pytest
from browser import Page, command

from radar_app.view.live import LiveSource
from radar_app.view.zones_file import ZonesFile

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def graph(scene):
    """The live graph, its scene again and again."""
    words = ("up", "--scene", str(scene), "--param", "driver.at_end=loop", "--param", "visualisation.rate=0.5")
    process = subprocess.Popen([sys.executable, "-m", "radar_app", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    yield process
    process.send_signal(2)
    process.wait(30)


def test_a_graph_is_shown_and_a_zone_drawn_on_the_plan_counts(driver, graph, tmp_path):
    """Points move, a gesture appears, nodes report; a zone is drawn by clicks, saved, read by the graph, and counts."""
    zones = tmp_path / "zones.yaml"
    with command("--port", "0", "--zones", str(zones)) as (_, address):
        page = Page(driver, address)
        first = page.until(lambda: page.data("points", "x"))
        page.until(lambda: page.data("points", "x") != first)
        page.until(lambda: page.data("people", "id"))
        page.until(lambda: any(name in page.gestures() for name in ("push", "swipe")))
        page.until(
            lambda: all(name in page.text("nodes_table") for name in ("driver", "baseband", "tracking", "gestures", "hand", "zones"))
        )
        page.until(
            lambda: page.driver.execute_script("return Bokeh.documents[0].get_model_by_name('range_doppler').data.image[0].length") > 4
        )

        page.press("zone_draw")
        page.until(lambda: page.model("zone_draw", "label") == "Cancel")
        for corner in [(1.0, 2.0), (1.0, -1.6), (4.0, -1.6), (4.0, 2.0)]:
            page.corner(*corner)
        page.set("zone_name", "value", "front")
        page.until(lambda: not page.model("zone_save", "disabled"))
        page.press("zone_save")
        page.until(lambda: zones.exists() and ZonesFile(zones).layout().zones)
        (zone,) = ZonesFile(zones).layout().zones
        assert zone.name == "front"
        assert len(zone.polygon) == 4
        assert zone.polygon[0] == pytest.approx((1.0, 2.0), abs=0.1)  # a pixel is some centimetres
        page.until(lambda: any(text in page.data("zone_labels", "text") for text in ("front 1", "front 2")))

        page.press("pause")
        page.until(lambda: "paused" in page.text("head"))
        page.set("scrub", "value", -2.0)
        page.until(lambda: "2.0 s back" in page.text("head"))


def test_no_thread_is_left(graph):
    """A source that has heard something ends with all that it started."""
    before = set(threading.enumerate())
    source = LiveSource()
    try:
        assert source.feed.wait(0, 90.0)
    finally:
        source.close()
    assert set(threading.enumerate()) == before
