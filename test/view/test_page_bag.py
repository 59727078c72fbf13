"""The page over recordings, without a graph, in a real browser."""

import pytest
from browser import Page, command

from radar_app.view.zones_file import ZonesFile

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]


def test_a_recording_is_shown_paused_and_scrubbed(driver, results):
    """Points move, a gesture appears with its probabilities; time stops, goes back, and goes on. Nothing comes from outside."""
    with command(str(results), "--loop", "--port", "0") as (_, address):
        page = Page(driver, address)
        first = page.until(lambda: page.data("points", "x"))
        page.until(lambda: page.data("points", "x") != first)
        page.until(lambda: len(page.data("people", "id")) == 2)
        page.until(lambda: "swipe left" in page.gestures())
        assert max(page.data("probabilities", "probability")) > 0.5
        assert page.data("person_maps", "micro_doppler")

        page.press("pause")
        page.until(lambda: "paused" in page.text("head"))
        stopped = page.data("sent", "n")
        page.until(lambda: page.data("drawn", "n") == page.data("sent", "n"))
        newest = page.data("people", "x")
        page.set("scrub", "value", -1.0)
        page.until(lambda: "s back" in page.text("head"))
        page.until(lambda: page.data("people", "x") != newest)
        page.set("scrub", "value", 0.0)
        page.until(lambda: page.data("people", "x") == newest)
        assert page.data("sent", "n")[0] <= stopped[0] + 6  # while paused it is sent only what is asked for
        page.press("pause")
        page.until(lambda: "playing" in page.text("head"))

        loaded = driver.execute_script("return performance.getEntriesByType('resource').map((entry) => entry.name)")
        assert loaded
        assert all(name.startswith(address) for name in loaded), loaded
        severe = [entry for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]
        assert not severe


def test_raw_frames_are_worked_out_and_zones_count(driver, frames, tmp_path):
    """A bag with frames only: the range-Doppler map and people come, a zone of the file counts, and one is deleted from the page."""
    zones = tmp_path / "zones.yaml"
    ZonesFile(zones).save("corner", "counting", [(1.0, 0.0), (3.5, 0.0), (3.5, 2.0), (1.0, 2.0)])
    with command(str(frames), "--loop", "--port", "0", "--zones", str(zones)) as (_, address):
        page = Page(driver, address)
        page.until(lambda: page.data("people", "id"))
        page.until(lambda: page.driver.execute_script(_DYNAMICS) > 20.0)  # dB: somebody stands out of the noise
        page.until(lambda: "corner 1" in page.data("zone_labels", "text"))
        page.set("zone_which", "value", "corner")
        page.until(lambda: page.model("zone_name", "value") == "corner")
        page.press("zone_delete")
        page.until(lambda: not ZonesFile(zones).layout().zones)
        page.until(lambda: page.data("zone_labels", "text") == [])


_DYNAMICS = """
const image = Bokeh.documents[0].get_model_by_name('range_doppler').data.image[0]
return Math.max(...image) - Math.min(...image) || 0
"""
