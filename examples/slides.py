"""Shows slides in a browser and turns them by hand: wave wakes it, a swipe offers the next slide, push confirms, pull cancels.

handwave up                       # terminal 1
python examples/slides.py         # terminal 2: prints the page's address; Ctrl-C ends it. A file of your own: slides.py talk.md
"""

import json
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import rclpy
from handwave.msg import Gesture

AWAKE = 8.0  # s: how long it listens after a wave, and after every gesture that it understood
GRACE = 1.5  # s: what a swipe offers happens by itself after so long, unless pull cancels it; push does not wait
SURE = 0.6  # what is less probable counts as nothing
TURNS = {"swipe_left": 1, "swipe_right": -1}  # as one pushes a sheet of paper aside
DEMO = "Slides by hand\n---\nWave: the frame turns green\n---\nSwipe, then push: the next slide\n---\nPull: it stays"
PAGE = Path(__file__).with_name("slides.html")


class Presenter:
    """The slides and the dialogue: nothing happens before a wave, what will happen is shown before it does, and pull takes it back."""

    def __init__(self, slides, clock=time.monotonic):
        self.slides, self.clock, self.lock = slides, clock, threading.Lock()
        self.number, self.offered, self.until, self.due = 0, None, float("-inf"), float("inf")

    def take(self, name, confidence):
        """Listen to one gesture."""
        with self.lock:
            self.settle()
            now = self.clock()
            if confidence < SURE or (name != "wave" and now >= self.until):
                return
            if name in TURNS:
                self.offered, self.due = min(max(self.number + TURNS[name], 0), len(self.slides) - 1), now + GRACE
            elif name == "push" and self.offered is not None:
                self.due = now
            elif name == "pull":
                self.offered, self.due, self.until = None, float("inf"), now if self.offered is None else self.until
            elif name != "wave":
                return
            if name == "wave" or now < self.until:
                self.until = now + AWAKE
            self.settle()

    def settle(self):
        """Carry out what is due."""
        if self.clock() >= self.due:
            self.number, self.offered, self.due = self.offered, None, float("inf")

    def state(self):
        """Give what the page shows."""
        with self.lock:
            self.settle()
            awake = self.clock() < self.until
            return {
                "number": self.number,
                "of": len(self.slides),
                "text": self.slides[self.number],
                "awake": awake,
                "offered": self.offered,
            }


def handler(presenter):
    """Answers with the page, and on /state with a line for every change."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200 if self.path in ("/", "/state") else 404)
            self.send_header("Content-Type", "text/event-stream" if self.path == "/state" else "text/html; charset=utf-8")
            self.end_headers()
            if self.path == "/":
                self.wfile.write(PAGE.read_bytes())
            last = None
            while self.path == "/state":
                try:
                    if (now := presenter.state()) != last:
                        self.wfile.write(f"data: {json.dumps(now)}\n\n".encode())
                        self.wfile.flush()
                        last = now
                except OSError:  # the browser has left
                    return
                time.sleep(0.05)

        def log_message(self, *_):
            """Say nothing."""

    return Handler


def main():
    """Run until Ctrl-C."""
    text = Path(sys.argv[1]).read_text(encoding="utf-8") if len(sys.argv) > 1 else DEMO
    presenter = Presenter([slide.strip() for slide in text.split("\n---\n")])
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler(presenter))
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    rclpy.init()
    node = rclpy.create_node("slides")
    node.create_subscription(Gesture, "gestures", lambda msg: presenter.take(msg.name, msg.confidence), 10)
    print(f"http://127.0.0.1:{server.server_port}/", flush=True)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    server.shutdown()


if __name__ == "__main__":
    main()
