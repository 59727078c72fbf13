"""The connection to an MQTT broker: made again after every loss, with a last will, and nothing old ever sent late."""

from __future__ import annotations

import os
import queue
import random
import ssl
import stat
import threading
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radar_core import ConfigError
from radar_core.config import config, knob

if TYPE_CHECKING:
    from paho.mqtt.client import Client

PASSWORD = "HANDWAVE_MQTT_PASSWORD"
"""Environment variable of the password, where no file has it."""

_BEAT = 0.02  # s: how long the connection's thread waits for the network before it looks for what there is to send
_FIRST_PAUSE = 0.25  # s: before the first new attempt; each next one is twice as long, up to retry_longest
_FAREWELL = 0.1  # s: for the last message, when told to end; without an answer the last will says the same
_PORT, _TLS_PORT = 1883, 8883  # registered for MQTT


@config
class BrokerConfig:
    """Where the broker is and who we are to it. The password is no knob: nodes show their knobs to everybody."""

    host: str = knob("localhost", doc="name or address of the MQTT broker")
    port: int = knob(0, doc="port of the broker; 0: 1883, or 8883 with TLS", low=0, high=65535)
    user: str = knob("", doc="user name at the broker; empty: none")
    password_file: str = knob("", doc=f"file whose first line is the password; empty: environment variable {PASSWORD}, if it is set")
    tls: bool = knob(False, doc="encrypt the connection and check the broker's certificate")
    ca_file: str = knob("", doc="certificates that the broker's is checked with (PEM); empty: the system's; needs tls")
    certificate_file: str = knob("", doc="own certificate, where the broker asks for one (PEM); needs tls and key_file")
    key_file: str = knob("", doc="key of the own certificate (PEM)")
    keep_alive: int = knob(3, doc="the broker says that we are offline after 1.5 times this silence", unit="s", low=1, high=3600)
    connect_timeout: float = knob(3.0, doc="how long one attempt to connect may take", unit="s", low=0.1, high=60.0)
    retry_longest: float = knob(3.0, doc="longest pause between two attempts to connect", unit="s", low=0.25, high=600.0)

    def validate(self) -> None:
        """Check what belongs together."""
        if not self.host.strip():
            raise ConfigError("host is empty; it must be the name or address of the MQTT broker, e.g. homeassistant.local")
        if any((self.ca_file, self.certificate_file, self.key_file)) and not self.tls:
            raise ConfigError("ca_file, certificate_file and key_file are of use only with tls: true")
        if bool(self.certificate_file) != bool(self.key_file):
            raise ConfigError("certificate_file and key_file belong together: give both or none")

    @property
    def address(self) -> str:
        """Host and port, as people write them."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port_number}"

    @property
    def port_number(self) -> int:
        """The port, where none was given the usual one."""
        return self.port or (_TLS_PORT if self.tls else _PORT)


def read_password(settings: BrokerConfig) -> tuple[str | None, str]:
    """Read the password from its file, else from the environment.

    Returns
    -------
    tuple of (str or None, str)
        The password, None where there is none, and what is unwise about it, for the log; empty: nothing.

    Raises
    ------
    ConfigError
        When the file cannot be read or is empty, or there is a password but no user. The text never holds the password.
    """
    path, advice = settings.password_file, ""
    if path:
        try:
            lines = Path(path).read_text(encoding="utf-8").splitlines()
            readable = bool(Path(path).stat().st_mode & (stat.S_IRGRP | stat.S_IROTH))
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "is no text"
            raise ConfigError(f"password_file {path}: cannot read it ({reason}); its first line must be the password") from None
        if not lines or not lines[0]:
            raise ConfigError(f"password_file {path}: its first line must be the password, but it is empty")
        password: str | None = lines[0]
        advice = f"others on this machine can read {path}, which holds a password: chmod 600 {path}" if readable else ""
    else:
        password = os.environ.get(PASSWORD) or None
    if password is not None and not settings.user:
        raise ConfigError(f"there is a password for the MQTT broker ({path or PASSWORD}) but no user; set the parameter user")
    return password, advice


def _library() -> Any:
    """Import the client library, which only who uses MQTT needs."""
    try:
        import paho.mqtt.client as library
    except ImportError:
        library = None  # type: ignore[assignment]
    if not hasattr(library, "CallbackAPIVersion"):  # versions before 2 have none
        raise ConfigError("the node mqtt needs the Python package paho-mqtt, version 2 or newer: pip install 'paho-mqtt>=2'")
    return library


class Link:
    """One client of a broker, with a thread that connects, sends and receives.

    What is kept (`keep`) is retained by the broker, and said again after every new connection: a broker may have lost it. What is told
    (`tell`) is sent now or never, at most once: a gesture of a minute ago must not switch a lamp.

    Parameters
    ----------
    settings : BrokerConfig
        Where the broker is.
    password : str or None
        For ``settings.user``.
    client_id : str
        The broker knows one connection of each; a new one ends the old one.
    will : tuple of (str, str)
        Topic and payload that the broker publishes when we are gone without a word, and we ourselves at the end.
    listen : str
        Filter of topics to receive; `received` has what came.

    Raises
    ------
    ConfigError
        When the library is missing, or a file of certificates cannot be used.
    """

    def __init__(self, settings: BrokerConfig, password: str | None, client_id: str, will: tuple[str, str], listen: str) -> None:
        self._settings, self._password, self._id, self._will, self._listen = settings, password, client_id, will, listen
        self._library = _library()
        self._tls = self._context()
        self._lock = threading.Lock()  # around the three that follow
        self._kept: dict[str, str] = {}
        self._waiting: deque[tuple[str, str, bool]] = deque()
        self._up = False
        self.connections = 0  # made so far
        self.received: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()  # topic and payload of retained messages that came
        self.said: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()  # for the log: whether it is bad news, and the text
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)

    def _context(self) -> ssl.SSLContext | None:
        """Make the TLS context, here rather than in the thread, so that wrong files end the node at once."""
        given = self._settings
        if not given.tls:
            return None
        try:
            context = ssl.create_default_context(cafile=given.ca_file or None)
            if given.certificate_file:
                context.load_cert_chain(given.certificate_file, given.key_file)
        except OSError as error:  # ssl.SSLError is one
            files = ", ".join(filter(None, (given.ca_file, given.certificate_file, given.key_file)))
            raise ConfigError(f"TLS cannot be used with {files}: {error.strerror or error}; they must be PEM files") from None
        return context

    @property
    def connected(self) -> bool:
        """Whether the broker takes what is told now."""
        return self._up

    def start(self) -> None:
        """Connect, and again whenever the connection is lost."""
        self._thread.start()

    def keep(self, topic: str, payload: str) -> None:
        """Let the broker retain this as the topic's last word; an empty payload takes the topic away. The same word again costs nothing."""
        with self._lock:
            if self._kept.get(topic) != payload:
                self._kept[topic] = payload
                if self._up:
                    self._waiting.append((topic, payload, True))

    def tell(self, topic: str, payload: str) -> bool:
        """Send this once, now; returns whether there is a connection to send it on."""
        with self._lock:
            if self._up:
                self._waiting.append((topic, payload, False))
            return self._up

    def close(self) -> None:
        """Say that we are offline and end; takes `_FAREWELL` at most where the broker does not answer."""
        self.keep(*self._will)
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(2 * _FAREWELL)

    def _run(self) -> None:
        pause = _FIRST_PAUSE
        while not self._ended.is_set():
            before = self.connections
            client = self._client()
            try:
                client.connect(self._settings.host, self._settings.port_number, self._settings.keep_alive)
                self._serve(client)
            except (OSError, ValueError) as error:  # a certificate that does not fit is a ValueError in some versions of Python
                self._say(f"cannot reach the MQTT broker {self._settings.address}: {_reason(error)}; trying again")
            with self._lock:
                self._up = False
            if self.connections > before:
                pause = _FIRST_PAUSE
            self._ended.wait(pause * random.uniform(0.8, 1.2))  # many clients that lost one broker must not all come back at once
            pause = min(2 * pause, self._settings.retry_longest)

    def _client(self) -> Client:
        """Make a client for one connection only: one that is used again would send what it could not send before."""
        library = self._library
        client: Client = library.Client(library.CallbackAPIVersion.VERSION2, client_id=self._id, protocol=library.MQTTv311)
        client.connect_timeout = self._settings.connect_timeout
        client.will_set(*self._will, qos=1, retain=True)
        if self._settings.user:
            client.username_pw_set(self._settings.user, self._password)
        if self._tls is not None:
            client.tls_set_context(self._tls)
        client.on_connect, client.on_disconnect, client.on_message = self._greet, self._lost, self._take
        return client

    def _serve(self, client: Client) -> None:
        """Send and receive until the connection is lost or we are told to end."""
        deadline = time.monotonic() + self._settings.connect_timeout
        while not self._ended.is_set():
            self._send(client)
            if client.loop(_BEAT) != self._library.MQTT_ERR_SUCCESS:
                return
            if not self._up and time.monotonic() > deadline:
                self._say(f"{self._settings.address} takes connections but does not answer; is it an MQTT broker, and with TLS or without?")
                return
        last = self._send(client)
        end = time.monotonic() + _FAREWELL
        while last is not None and not last.is_published() and time.monotonic() < end:
            if client.loop(_BEAT) != self._library.MQTT_ERR_SUCCESS:
                return
        client.disconnect()

    def _send(self, client: Client) -> Any:
        """Hand over what waits; returns the library's note about the last message, None: there was nothing."""
        note = None
        while self._up:
            with self._lock:
                if not self._waiting:
                    break
                topic, payload, retain = self._waiting.popleft()
            note = client.publish(topic, payload, qos=int(retain), retain=retain)
        return note

    def _greet(self, client: Client, _data: Any, _flags: Any, code: Any, _properties: Any) -> None:
        """Say everything that is kept, once the broker has answered."""
        if code.is_failure:
            who = f"user {self._settings.user!r}" if self._settings.user else "no user name"
            advice = f"check user, password_file or {PASSWORD}; trying again"
            self._say(f"the MQTT broker {self._settings.address} refuses {who} ({code}): {advice}")
            return
        client.subscribe(self._listen, qos=0)
        with self._lock:
            self._waiting.clear()
            self._waiting.extend((topic, payload, True) for topic, payload in self._kept.items())
            self._up = True
            self.connections += 1
        self.said.put((False, f"connected to the MQTT broker {self._settings.address} as {self._id}"))

    def _lost(self, _client: Client, _data: Any, _flags: Any, code: Any, _properties: Any) -> None:
        if self._up and not self._ended.is_set():
            self._say(f"lost the MQTT broker {self._settings.address} ({code}); trying again. Only one program may be {self._id} there")
        with self._lock:
            self._up = False

    def _take(self, _client: Client, _data: Any, message: Any) -> None:
        if message.retain:
            self.received.put((message.topic, message.payload.decode("utf-8", "replace")))

    def _say(self, text: str) -> None:
        if not self._ended.is_set():
            self.said.put((True, text))


def _reason(error: Exception) -> str:
    """Say what went wrong, in few words."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not trusted ({error.verify_message}); the parameter ca_file says with which ones it is checked"
    return str(getattr(error, "strerror", None) or error)
