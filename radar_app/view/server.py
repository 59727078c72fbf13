"""The server: one page for every browser, of one source."""

from __future__ import annotations

import errno
import logging
import secrets
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.auth_provider import NullAuth
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from bokeh.settings import settings
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop

from radar_app.view.access import LOCAL, TokenAuth, origins
from radar_app.view.page import Context, Page, Source, TabMaker
from radar_core import ConfigError
from radar_ros.signals import SIGNALS

_LOOK_MS, _GONE_MS = 2000, 5000  # how often pages are looked for whose browser has left, and how long after that they end


@dataclass(frozen=True)
class ServerOptions:
    """Where the page is seen, and by whom."""

    port: int = 5006  # 0: any that is free
    host: str = LOCAL  # address to listen on
    token: str = ""  # that others need; empty: nobody else reaches it, so none is needed


class ViewServer:
    """Serves the page until it is told to stop.

    Parameters
    ----------
    source : Source
        Where the data comes from.
    tabs : sequence of TabMaker
        What the page shows, in order.
    options : ServerOptions
        Where it is seen.

    Attributes
    ----------
    port : int
        On which it listens.

    Raises
    ------
    ConfigError
        When the port is taken or the address is none of this machine.
    """

    def __init__(self, source: Source, tabs: Sequence[TabMaker], options: ServerOptions | None = None) -> None:
        options = options or ServerOptions()
        settings.resources = "server"  # whatever the environment says: no scripts from outside
        for name in ("tornado.access", "bokeh"):
            logging.getLogger(name).setLevel(logging.ERROR)
        self._pages: list[Page] = []

        def make(document: Document) -> None:
            page = Page(Context(source, document), tabs)
            self._pages.append(page)
            document.on_session_destroyed(self._leaver(page))

        application = Application(FunctionHandler(make))
        try:
            sockets, self.port = bind_sockets(options.host, options.port)
        except OSError as error:
            raise ConfigError(_why(error, options)) from None
        tornado = BokehTornado(
            {"/": application}, extra_websocket_origins=origins(options.host, self.port), include_headers=[], include_cookies=[],
            auth_provider=TokenAuth(options.token) if options.token else NullAuth(), sign_sessions=True, secret_key=_secret(),
            check_unused_sessions_milliseconds=_LOOK_MS, unused_session_lifetime_milliseconds=_GONE_MS,
        )  # fmt: skip
        http = HTTPServer(tornado)
        http.add_sockets(sockets)
        self._server = BaseServer(IOLoop.current(), tornado, http)

    def _leaver(self, page: Page) -> Callable[[object], None]:
        def leave(_: object) -> None:
            if page in self._pages:
                self._pages.remove(page)
                page.close()

        return leave

    def run(self) -> int:
        """Serve until a signal ends it; returns its number."""
        loop, told = self._server.io_loop, [0]

        def stop(number: int, _: object) -> None:
            told[0] = number
            loop.add_callback_from_signal(loop.stop)

        before = {number: signal.signal(number, stop) for number in SIGNALS}  # an exception would be raised in the middle of anything
        try:
            self._server.start()
            loop.start()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        return told[0]

    def close(self) -> None:
        """Close all pages."""
        for page in self._pages:
            page.close()
        self._pages.clear()
        self._server.stop(wait=False)


def _secret() -> bytes:
    """Make the key that signs the sessions of this run."""
    return secrets.token_urlsafe(32).encode()


def _why(error: OSError, options: ServerOptions) -> str:
    """Say why the page cannot be served there, and what to do."""
    if error.errno == errno.EADDRINUSE:
        return f"port {options.port} is taken, perhaps by another page; choose another one with --port, or any free one with --port 0"
    if error.errno == errno.EACCES:
        return f"port {options.port} is not for users; choose one from 1024 on with --port"
    return f"{options.host}:{options.port} cannot be listened on ({error.strerror or error}); --host takes an address of this machine"
