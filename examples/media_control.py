"""Plays music by hand: wave to wake it, then push plays or pauses, swipes choose and set the volume, pull cancels.

handwave up                        # terminal 1
pip install jeepney                # D-Bus in Python
python examples/media_control.py   # terminal 2; Ctrl-C ends it; any player that speaks MPRIS: VLC, Spotify, a browser
"""

import time

import rclpy
from handwave.msg import Gesture
from jeepney import DBusAddress, DBusErrorResponse, Properties, message_bus, new_method_call
from jeepney.io.blocking import Proxy, open_dbus_connection

AWAKE = 6.0  # s: how long it listens after a wave, and after every command
SURE = 0.6  # what is less probable counts as nothing
STEP = 0.1  # of the volume
COMMANDS = {"push": "PlayPause", "swipe_right": "Next", "swipe_left": "Previous", "swipe_up": STEP, "swipe_down": -STEP}


class Player:
    """The first player on the session bus; who ends and comes again is found again."""

    def __init__(self):
        self.connection = open_dbus_connection(bus="SESSION")
        self.bus = Proxy(message_bus, self.connection)

    def address(self):
        """Who plays; None: nobody."""
        names = sorted(name for name in self.bus.ListNames()[0] if name.startswith("org.mpris.MediaPlayer2."))
        return DBusAddress("/org/mpris/MediaPlayer2", names[0], "org.mpris.MediaPlayer2.Player") if names else None

    def send(self, message):
        """Call, and wait for the answer for two seconds."""
        answer = self.connection.send_and_get_reply(message, timeout=2.0)
        if answer.header.message_type.name == "error":
            raise DBusErrorResponse(answer)
        return answer.body

    def do(self, command):
        """Carry out a name of a method, or a change of the volume; returns what to tell."""
        player = self.address()
        if player is None:
            return "no player"
        if isinstance(command, str):
            self.send(new_method_call(player, command))
            return command
        ((_, volume),) = self.send(Properties(player).get("Volume"))
        volume = min(max(volume + command, 0.0), 1.0)
        self.send(Properties(player).set("Volume", "d", volume))
        return f"volume {100 * volume:.0f} %"


class Dialogue:
    """Forgives: nothing happens before a wave, pull takes back the wake-up, silence ends it, and all that is done is told."""

    def __init__(self, do, tell, clock=time.monotonic):
        self.do, self.tell, self.clock = do, tell, clock
        self.until = float("-inf")

    def take(self, name, confidence):
        """Listen to one gesture."""
        now = self.clock()
        if confidence < SURE:
            return
        if name == "wave":
            self.until = now + AWAKE
            self.tell("listening")
        elif now < self.until and name == "pull":
            self.until = now
            self.tell("cancelled")
        elif now < self.until and name in COMMANDS:
            self.until = now + AWAKE
            try:
                self.tell(self.do(COMMANDS[name]))
            except (DBusErrorResponse, TimeoutError) as error:
                self.tell(f"the player refused: {error}")


def main():
    """Run until Ctrl-C."""
    player = Player()
    dialogue = Dialogue(player.do, lambda text: print(text, flush=True))  # replace print by a light or a sound
    rclpy.init()
    node = rclpy.create_node("media_control")
    node.create_subscription(Gesture, "gestures", lambda msg: dialogue.take(msg.name, msg.confidence), 10)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
