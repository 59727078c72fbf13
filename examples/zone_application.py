"""Switches a lamp at the desk: on while somebody is there, off afterwards. Here the lamp is a line of text.

handwave up --zones examples/zones.yaml    # terminal 1
python examples/zone_application.py        # terminal 2; Ctrl-C ends it
"""

import rclpy
from handwave.msg import Zone, ZoneArray
from rclpy.qos import DurabilityPolicy, QoSProfile

# Zones are latched: who joins late gets the last word at once.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class DeskLamp:
    """Follows the presence of the zone desk, which has the delays of the zones file."""

    def __init__(self, node):
        self.lit = False
        node.create_subscription(ZoneArray, "zones", self.take, LATCHED)

    def take(self, msg):
        """Switch when the presence at the desk is another one; leave the lamp alone while nobody knows (the radar is silent)."""
        for zone in msg.zones:
            if zone.name == "desk" and zone.presence != Zone.UNKNOWN:
                self.switch(zone.presence == Zone.OCCUPIED)

    def switch(self, lit):
        """Replace this by your lamp."""
        if lit != self.lit:
            self.lit = lit
            print(f"lamp {'on' if lit else 'off'}", flush=True)


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    node = rclpy.create_node("desk_lamp")
    lamp = DeskLamp(node)  # noqa: F841  the node calls it as long as it lives
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
