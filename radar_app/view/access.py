"""Who may see the page: everybody on this machine, or, over the network, who knows a token."""

from __future__ import annotations

import asyncio
import hmac
import html
import os
import secrets
import socket
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

import psutil
from bokeh.server.auth_provider import AuthProvider
from tornado.web import HTTPError, RequestHandler
from tornado.websocket import WebSocketHandler

from radar_app.view.style import ACCENT, CARD, FONT, GROUND, LINE, TEXT
from radar_core import ConfigError

LOCAL: Final = "127.0.0.1"
"""Where the page is seen unless the user says otherwise."""

VARIABLE: Final = "HANDWAVE_VIEW_TOKEN"
"""Environment variable that may hold the token."""

LOGIN: Final = "/login"
_COOKIE: Final = "handwave_view"
_LEAST: Final = 16  # characters of a token: fewer can be guessed
_PAUSE: Final = 1.0  # s: after a wrong token
_LONG: Final = 12 * 3600  # s: how long a browser is remembered

_FORM: Final = f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Handwave</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline';
  form-action 'self'">
<style>
  body {{ background: {GROUND}; color: {TEXT}; font: 16px {FONT}; display: grid; place-items: center; min-height: 90vh; margin: 0; }}
  form {{ background: {CARD}; border: 1px solid {LINE}; border-radius: 12px; padding: 24px; display: grid; gap: 12px; }}
  form {{ width: min(320px, 84vw); }}
  input, button {{ font: inherit; padding: 10px; border-radius: 8px; border: 1px solid {LINE}; background: {GROUND}; color: {TEXT}; }}
  button {{ background: {ACCENT}; color: {GROUND}; font-weight: 600; }}
</style></head><body>
<form method="post" action="login"><label for="token">Token of this page</label>
<input id="token" name="token" type="password" autocomplete="off" autofocus required>
<button>Open</button><div role="alert">{{said}}</div></form>
<script>
  // A token behind "#" never reaches the server's log or anybody's between: browsers do not send it.
  const token = decodeURIComponent(location.hash.slice(1))
  if (token) {{
    history.replaceState(null, "", location.pathname)
    document.getElementById("token").value = token
    document.forms[0].submit()
  }}
</script></body></html>
"""


def find_token(file: Path | None) -> tuple[str, bool]:
    """Give the token of a page that others may see, and whether it was made here: from a file, the environment, or at random.

    A `ConfigError` says that the file cannot be read, or that the token is too short to keep anybody out.
    """
    if file is not None:
        try:
            token, where = file.read_text(encoding="utf-8").strip(), str(file)
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{file}: cannot read the token ({error}); check the path") from None
    elif VARIABLE in os.environ:
        token, where = os.environ[VARIABLE].strip(), f"${VARIABLE}"
    else:
        return secrets.token_urlsafe(24), True
    if len(token) < _LEAST:
        raise ConfigError(f"{where}: the token has {len(token)} characters and could be guessed; give at least {_LEAST}")
    return token, False


def origins(host: str, port: int) -> list[str]:
    """Names, with the port, under which a browser may open the page: those of this machine, so that no other site can."""
    if host == LOCAL:
        names = [LOCAL, "localhost"]
    else:
        found = {address.address.partition("%")[0] for card in psutil.net_if_addrs().values() for address in card}
        own = [address if ":" not in address else f"[{address}]" for address in found if _is_address(address)]
        name = socket.gethostname()
        names = [LOCAL, "localhost", host, name, name.partition(".")[0], f"{name.partition('.')[0]}.local", *sorted(own)]
    return [f"{name}:{port}" for name in dict.fromkeys(names)]


def addresses(host: str) -> list[str]:
    """Addresses to tell the user under which others reach a page that is bound to ``host``."""
    if host not in ("0.0.0.0", "::"):
        return [host]
    cards = psutil.net_if_addrs().values()
    return sorted({a.address for card in cards for a in card if a.family == socket.AF_INET and not a.address.startswith("127.")})


def _is_address(text: str) -> bool:
    for family in (socket.AF_INET, socket.AF_INET6):
        try:
            socket.inet_pton(family, text)
        except OSError:
            continue
        return True
    return False


class TokenAuth(AuthProvider):
    """Lets in who has told the token; a browser is remembered by a cookie, whose value is another secret, made for this run."""

    def __init__(self, token: str) -> None:
        self._token, self._session = token.encode(), secrets.token_urlsafe(32)
        super().__init__()

    @property
    def get_user(self) -> None:
        """Nobody is known without waiting."""
        return None

    @property
    def get_user_async(self) -> Callable[[Any], Awaitable[Any]]:
        """Tell whether a request is of somebody who has told the token."""

        async def user(handler: RequestHandler) -> str | None:
            given = handler.get_cookie(_COOKIE) or ""
            if hmac.compare_digest(given.encode(), self._session.encode()):
                return "known"
            if isinstance(handler, WebSocketHandler):
                raise HTTPError(403)
            return None

        return user

    @property
    def login_url(self) -> str:
        """Where the token is told."""
        return LOGIN

    @property
    def get_login_url(self) -> None:
        """The same for all."""
        return None

    @property
    def login_handler(self) -> type[RequestHandler]:
        """Make the page on which the token is told."""
        token, session = self._token, self._session

        class Login(RequestHandler):
            def get(self) -> None:
                self.write(_FORM.replace("{said}", ""))

            async def post(self) -> None:
                if not hmac.compare_digest(self.get_body_argument("token", "").strip().encode(), token):
                    await asyncio.sleep(_PAUSE)
                    self.set_status(403)
                    self.write(_FORM.replace("{said}", html.escape("This is not the token. It stands where the page was started.")))
                    return
                self.set_cookie(_COOKIE, session, httponly=True, samesite="Strict", max_age=_LONG)
                self.redirect("./")

        return Login

    @property
    def logout_url(self) -> None:
        """Closing the browser is enough."""
        return None

    @property
    def logout_handler(self) -> None:
        """There is none."""
        return None
