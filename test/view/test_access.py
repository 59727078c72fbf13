"""Who may see the page: over the network only who knows the token, which is never told to a log."""

import http.client
import os
import urllib.parse

import pytest
from browser import Page, command

from radar_app.view.access import VARIABLE, find_token, origins
from radar_core import ConfigError

TOKEN = "correct horse battery"


def test_tokens_are_found(tmp_path, monkeypatch):
    """In a file, in the environment, or made anew; what could be guessed is refused."""
    file = tmp_path / "token"
    file.write_text(f"{TOKEN}\n")
    assert find_token(file) == (TOKEN, False)
    monkeypatch.setenv(VARIABLE, TOKEN)
    assert find_token(None) == (TOKEN, False)
    monkeypatch.setenv(VARIABLE, "short")
    with pytest.raises(ConfigError, match="could be guessed"):
        find_token(None)
    monkeypatch.delenv(VARIABLE)
    (one, fresh), (other, _) = find_token(None), find_token(None)
    assert fresh
    assert one != other
    assert len(one) >= 24
    with pytest.raises(ConfigError, match="cannot read the token"):
        find_token(tmp_path / "nowhere")


def test_no_other_site_may_open_the_page():
    """Only names of this machine, with the port."""
    assert origins("127.0.0.1", 5006) == ["127.0.0.1:5006", "localhost:5006"]
    wide = origins("0.0.0.0", 5006)
    assert "127.0.0.1:5006" in wide
    assert not any("*" in origin for origin in wide)


def _ask(port, method, path, body=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    return answer, answer.read().decode()


def _upgrade(port, origin, **headers):
    """Ask for the connection over which the page is fed."""
    fixed = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    return _ask(port, "GET", "/ws", Origin=origin, **{"Sec-WebSocket-Protocol": "bokeh, x"}, **fixed, **headers)[0].status


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_wrong_token_is_refused_and_the_right_one_opens(driver, results):
    """Without it there is no page and no connection that feeds one; the token stands nowhere in the output."""
    with command(str(results), "--loop", "--port", "0", "--host", "0.0.0.0", env={**os.environ, VARIABLE: TOKEN}) as (process, address):
        port = urllib.parse.urlsplit(address).port
        own = f"http://127.0.0.1:{port}"
        for path in ("/", "/?token=" + urllib.parse.quote(TOKEN)):
            answer, _ = _ask(port, "GET", path)
            assert answer.status == 302
            assert answer.headers["Location"].startswith("/login")
        assert _upgrade(port, own) == 403
        form = {"Content-Type": "application/x-www-form-urlencoded"}
        answer, text = _ask(port, "POST", "/login", urllib.parse.urlencode({"token": TOKEN[:-1]}), **form)
        assert answer.status == 403
        assert "not the token" in text
        assert "Set-Cookie" not in answer.headers
        assert _upgrade(port, own, Cookie="handwave_view=" + TOKEN.replace(" ", "")) == 403
        answer, _ = _ask(port, "POST", "/login", urllib.parse.urlencode({"token": TOKEN}), **form)
        cookie = answer.headers["Set-Cookie"].partition(";")[0]
        assert TOKEN not in cookie
        assert "HttpOnly" in answer.headers["Set-Cookie"]
        answer, text = _ask(port, "GET", "/", Cookie=cookie)
        assert answer.status == 200
        assert cookie.partition("=")[2] not in text  # no script of the page can read it
        assert _upgrade(port, "http://elsewhere.invalid", Cookie=cookie) == 403

        page = Page(driver, f"{own}/login#{urllib.parse.quote(TOKEN)}")
        page.until(lambda: page.data("people", "id"))
        assert TOKEN not in driver.current_url
    assert TOKEN not in process.stdout.read() + process.stderr.read()
