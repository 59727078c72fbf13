"""A small room, as a scene and as recordings."""

import pytest
from browser import chromium, needs_chromium

from radar_ros.bags import BagWriter
from radar_ros.offline import copy_info, process_recording, simulate, simulators, write_results

SCENE = """
duration: 5.5
seed: 3
purpose: gestures
effects:
  noise: {noise_figure: 15}
people:
  - {id: 1, position: [2.2, 0.8], script: [{gesture: push, at: 1.4}, {gesture: swipe_left, at: 3.6}]}
  - {id: 2, position: [4.6, -2.0], script: [{walk: {to: [2.6, -1.0], speed: 1.1}}, {walk: {to: [4.6, -2.0], speed: 1.1}}]}
"""


@pytest.fixture(scope="session")
def scene(tmp_path_factory):
    """Somebody who pushes and swipes, and somebody who walks and ends where they began: the scene is played again and again."""
    path = tmp_path_factory.mktemp("scene") / "room.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="session")
def frames(scene, tmp_path_factory):
    """The scene as raw frames."""
    path = tmp_path_factory.mktemp("frames") / "room"
    for _ in simulate(simulators(scene), path):
        pass
    return path


@pytest.fixture(scope="session")
def results(frames, tmp_path_factory):
    """The same as results only."""
    path = tmp_path_factory.mktemp("results") / "room"
    with BagWriter(path) as writer:
        copy_info(frames, writer)
        for stamp_ns, result in process_recording(frames):
            write_results(writer, stamp_ns, result)
    return path


@pytest.fixture(scope="session")
def driver(tmp_path_factory):
    """One browser for all tests."""
    needs_chromium()
    with chromium(tmp_path_factory.mktemp("profile")) as made:
        yield made
