"""Slides by hand: the dialogue with a clock, and the page in a real Chromium, turned by real messages."""

import importlib.util
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "test" / "view"))

from browser import chromium, needs_chromium


def load():
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("slides", ROOT / "examples/slides.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_dialogue_forgives():
    """Asleep it does nothing; a swipe offers, push confirms at once and time later, pull cancels, then ends it, as silence does."""
    example, now = load(), [0.0]
    presenter = example.Presenter(["a", "b", "c"], lambda: now[0])

    def after(name, confidence=0.9, wait=0.0):
        presenter.take(name, confidence)
        now[0] += wait
        state = presenter.state()
        return state["text"], state["offered"], state["awake"]

    assert after("swipe_left") == ("a", None, False)
    assert after("wave", 0.3) == ("a", None, False)
    assert after("wave") == ("a", None, True)
    assert after("push") == ("a", None, True)  # nothing is offered
    assert after("swipe_left") == ("a", 1, True)
    assert after("push") == ("b", None, True)
    assert after("swipe_left", wait=example.GRACE) == ("c", None, True)
    assert after("swipe_left", wait=example.GRACE) == ("c", None, True)  # there is no further one
    assert after("swipe_right") == ("c", 1, True)
    assert after("pull", wait=example.GRACE) == ("c", None, True)
    assert after("pull") == ("c", None, False)
    assert after("swipe_right", wait=example.GRACE) == ("c", None, False)
    assert after("wave", wait=example.AWAKE) == ("c", None, False)


@pytest.mark.long
def test_slides_turn_in_a_browser(tmp_path):
    """A talk of two slides: awake after a wave, the offer is shown, pull leaves the slide, push turns it; Ctrl-C ends it well."""
    needs_chromium()
    import rclpy
    from handwave.msg import Gesture
    from selenium.webdriver.common.by import By

    talk = tmp_path / "talk.md"
    talk.write_text("one <b>bold</b>\n---\ntwo", encoding="utf-8")
    process = subprocess.Popen([sys.executable, ROOT / "examples/slides.py", talk], stdout=subprocess.PIPE, text=True)
    rclpy.init()
    node = rclpy.create_node("somebody")
    try:
        address = process.stdout.readline().strip()
        publisher = node.create_publisher(Gesture, "gestures", 10)
        with chromium(tmp_path / "profile") as driver:
            driver.get(address)

            def shown():
                text, offer = (driver.find_element(By.ID, name).text for name in ("text", "offer"))
                return text, bool(offer), "awake" in driver.find_element(By.TAG_NAME, "body").get_attribute("class")

            def until(wanted, timeout=30.0):
                end = time.monotonic() + timeout
                while shown() != wanted:
                    assert time.monotonic() < end, shown()
                    time.sleep(0.05)

            def gesture(name):
                publisher.publish(Gesture(name=name, confidence=0.95))

            until(("one <b>bold</b>", False, False))
            end = time.monotonic() + 30.0
            while publisher.get_subscription_count() == 0:
                assert time.monotonic() < end
                time.sleep(0.05)
            gesture("wave")
            until(("one <b>bold</b>", False, True))
            gesture("swipe_left")
            until(("one <b>bold</b>", True, True))
            gesture("pull")
            until(("one <b>bold</b>", False, True))
            gesture("swipe_left")
            gesture("push")
            until(("two", False, True))
            process.send_signal(2)
            assert process.wait(30) == 0
    finally:
        node.destroy_node()
        rclpy.shutdown()
        process.kill()
        process.wait()
