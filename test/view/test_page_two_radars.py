"""The page over two radars that are fused: both are on the plan, and the range-Doppler map is of the one that is chosen."""

import pytest
from browser import Page, command
from running import RunningGraph

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

SCENE = """
duration: 300.0
seed: 14
radars:
  - {frame_id: left/radar, mount: {y: 0.8, z: 1.2, yaw: -0.3}, waveform: &slow {n_sample: 32, bandwidth: 0.75e+9, frame_interval: 0.1}}
  - {frame_id: right/radar, mount: {y: -0.8, z: 1.2, yaw: 0.3}, waveform: *slow}
effects: {noise: {noise_figure: 15}, losses: {level: 20}}
people:
  - {id: 1, position: [2.3, 0.0], script: [{draw: {shape: circle, duration: 298.0, size: 0.28, speed: 0.7}}]}
"""
MOST = 600  # clouds: a minute of an idle machine
IMAGE = "return Array.from(Bokeh.documents[0].get_model_by_name('range_doppler').data.image[0])"

NUMBER = "Bokeh.documents[0].get_model_by_name('{}').data.n[0]"
DRAWN = f"return {NUMBER.format('sent')} == {NUMBER.format('drawn')}"


@pytest.fixture
def graph(driver, tmp_path):
    # drivers start when they are ready: frames lie up to 50 ms apart
    made = RunningGraph(tmp_path, SCENE, "two_radars", "--param", "fusion.slop=0.06", stage="tracking")
    yield made
    made.end()


def test_two_radars_are_shown(driver, graph):
    """Places and fields of view of both, one person of whom both have points, both range-Doppler maps, and latencies of fused results."""
    with command("--port", "0") as (_, address):
        page = Page(driver, address)
        graph.until(page, lambda: page.data("radars", "text") == ["left", "right"], MOST)
        assert page.data("radars", "y") == pytest.approx([0.8, -0.8])
        assert len(page.data("views", "x")) == 2
        graph.until(page, lambda: len(page.data("people", "id")) == 1, MOST)
        page.until(lambda: page.model("range_doppler_radar", "options") == ["left/radar", "right/radar"])
        assert page.model("range_doppler_radar", "visible")
        page.until(lambda: page.model("range_doppler_radar", "value") == "left/radar")
        page.until(lambda: len(page.driver.execute_script(IMAGE)) > 4)
        page.press("pause")
        page.until(lambda: "paused" in page.text("head"))
        page.until(lambda: page.driver.execute_script(DRAWN))
        left = page.driver.execute_script(IMAGE)
        page.set("range_doppler_radar", "value", "right/radar")  # also while time stands still
        page.until(lambda: page.driver.execute_script(IMAGE) != left)
        page.set("range_doppler_radar", "value", "left/radar")
        page.until(lambda: page.driver.execute_script(IMAGE) == left)
        page.press("pause")
        graph.until(page, lambda: page.data("latency", "latency"), MOST)
        for stage in ("left/baseband", "right/baseband", "fusion", "tracking"):
            graph.until(page, lambda stage=stage: figures(page).get(stage, "").isdigit(), MOST)


def figures(page):
    """From a frame to here [ms], as the table of nodes has it."""
    find = "Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('nodes_table')).shadow_el.querySelectorAll('tr')"
    rows = page.driver.execute_script(f"return [...{find}].map((row) => [...row.cells].map((cell) => cell.textContent))")
    return {row[0].removeprefix("● "): row[3] for row in rows}
