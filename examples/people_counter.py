"""Prints how many people are in the room, whenever that changes.

handwave up                          # terminal 1: a graph, here on a simulated room
python examples/people_counter.py    # terminal 2; Ctrl-C ends it
"""

import rclpy
from std_msgs.msg import UInt32


class PeopleCounter:
    """Listens to the topic people_count, on which tracking says with every cloud how many people it follows."""

    def __init__(self, node):
        self.last = None
        node.create_subscription(UInt32, "people_count", self.take, 10)

    def take(self, msg):
        """Print the count when it is another one than before."""
        if msg.data != self.last:
            self.last = msg.data
            print(f"{msg.data} {'person' if msg.data == 1 else 'people'} in the room", flush=True)


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    node = rclpy.create_node("people_counter")
    counter = PeopleCounter(node)  # noqa: F841  the node calls it as long as it lives
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
