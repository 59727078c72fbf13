"""A lamp that follows a room over MQTT: on while somebody is there, and a swipe down switches it off. Here the lamp is a line of text.

handwave up --mqtt localhost              # terminal 1: needs a broker (apt-get install mosquitto)
python examples/mqtt_lamp.py localhost    # terminal 2; Ctrl-C ends it
"""

import json
import sys
import threading

import paho.mqtt.client as mqtt

ROOM = "handwave/handwave"  # with --param "mqtt.room=Living room" it is handwave/living_room


class Lamp:
    """Listens to two topics of the room; docs/how-to/home.md has all of them."""

    def __init__(self, host, port=1883):
        self.lit = False
        self.client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        self.client.on_connect = self.connected
        self.client.on_message = self.take
        self.client.connect(host, port)

    def connected(self, client, *_):
        """Subscribe at every connection: a broker that was started again has forgotten us."""
        client.subscribe([(f"{ROOM}/occupancy", 1), (f"{ROOM}/gesture", 1)])

    def take(self, client, _, message):
        """Switch when somebody comes or all are gone, and at a swipe."""
        if message.topic.endswith("/occupancy"):
            self.switch(message.payload == b"ON")
        elif json.loads(message.payload)["event_type"] == "swipe_down":
            self.switch(False)

    def switch(self, lit):
        """Replace this by your lamp."""
        if lit != self.lit:
            self.lit = lit
            print(f"lamp {'on' if lit else 'off'}", flush=True)


def main():
    """Run until Ctrl-C."""
    host, _, port = (sys.argv[1] if len(sys.argv) > 1 else "localhost").partition(":")
    lamp = Lamp(host, int(port or 1883))
    lamp.client.loop_start()  # in a thread of its own, so that Ctrl-C never falls into the middle of a message
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        lamp.client.disconnect()
        lamp.client.loop_stop()


if __name__ == "__main__":
    main()
