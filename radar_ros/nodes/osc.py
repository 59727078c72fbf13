"""OSC node: the hand, gestures and the number of people as Open Sound Control messages over UDP, for instruments and shows."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterable
from typing import Any

import handwave.msg
from std_msgs.msg import UInt32

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_ros import qos
from radar_ros.params import declare_config
from radar_ros.stage import StageNode, run

Message = tuple[str, list[Any]]  # address below the prefix, arguments


@config
class OscConfig:
    """Where the messages go."""

    host: str = knob("localhost", doc="name or address of the machine with the instrument")
    port: int = knob(9000, doc="UDP port that the instrument listens to", low=1, high=65535)
    prefix: str = knob("", doc="how all addresses begin; empty: /handwave, and the namespace behind it")

    def validate(self) -> None:
        """Check that addresses can begin like this."""
        if self.prefix and not re.fullmatch(r"(/[^\s#*,/?\[\]{}]+)+", self.prefix):
            raise ConfigError(
                f"prefix is {self.prefix!r}; an OSC address begins with / and has no blank nor any of #*,?[]{{}}, e.g. /radar"
            )


class OscNode(StageNode):
    """Sends what comes at once: all that one hand message holds as one bundle, so that it takes effect together."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("osc", **kwargs)
        self._config = declare_config(self, OscConfig)
        self._prefix = self._config.prefix or f"/handwave{self.get_namespace()}".rstrip("/")
        self._client = _client(self._config)
        self._people = -1  # as said last; -1: not known
        self.create_subscription(handwave.msg.HandTrack, "hand", self._hand, qos.RESULT)
        self.create_subscription(handwave.msg.Gesture, "gestures", self._gesture, qos.RESULT)
        self.create_subscription(UInt32, "people_count", self._count, qos.NEWEST)
        self.get_logger().info(f"sending {self._prefix}/... to {self._config.host}:{self._config.port}")

    def _hand(self, msg: Any) -> None:
        messages: list[Message] = [("hand/active", [int(msg.active)])]
        if msg.active:
            messages += [
                ("hand/value", [float(msg.value)]),
                ("hand/position", [float(x) for x in msg.position]),
                ("hand/velocity", [float(v) for v in msg.velocity]),
            ]
        self._send(messages)

    def _gesture(self, msg: Any) -> None:
        if msg.label != handwave.msg.Gesture.RANDOM:
            confidence = float(msg.confidence)
            self._send([("gesture", [msg.name, confidence, int(msg.track_id)]), (f"gesture/{msg.name}", [confidence])])

    def _count(self, msg: Any) -> None:
        self.hear()
        if self._people < 0:
            self._send([("data", [1])])
        if msg.data != self._people:
            self._people = msg.data
            self._send([("people", [int(msg.data)])])

    def on_stale(self) -> None:
        """Nothing comes any more: no instrument shall hold its note for ever."""
        self._people = -1
        self._send([("data", [0]), ("hand/active", [0])])

    def _send(self, messages: Iterable[Message]) -> None:
        from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
        from pythonosc.osc_message_builder import build_msg

        bundle = OscBundleBuilder(IMMEDIATELY)
        for address, values in messages:
            bundle.add_content(build_msg(f"{self._prefix}/{address}", values))
        try:
            self._client.send(bundle.build())
        except OSError as error:
            self.refuse(f"cannot send to {self._config.host}:{self._config.port}: {error.strerror or error}")
        else:
            self.processed += 1

    def close(self) -> None:
        """Let go of the socket."""
        self._client.close()


def _client(settings: OscConfig) -> Any:
    """Make the sender; a `ConfigError` says that the library is missing or that the host is not known."""
    try:
        from pythonosc.udp_client import UDPClient
    except ImportError:
        raise ConfigError("the node osc needs the Python package python-osc: pip install python-osc") from None
    try:
        found = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise ConfigError(
            f"host {settings.host!r} is not known ({error.strerror or error}); give the instrument's name or address"
        ) from None
    # By number, or the library would look the name up with every message; IPv4 before IPv6, because that is what instruments listen to.
    address = min(found, key=lambda entry: entry[0] != socket.AF_INET)[4][0]
    return UDPClient(str(address), settings.port)


make_node = OscNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
