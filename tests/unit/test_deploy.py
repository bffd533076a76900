"""Whom the server lets in, what it refuses to start with, and what it does with a password."""

from __future__ import annotations

import contextlib
import http.client
import http.cookiejar
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from email.message import Message
from itertools import chain
from pathlib import Path

import pytest
from bokeh.client import pull_session

from streamdash.cli.common import InputError
from streamdash.cli.deploy import (
    Deployment,
    check,
    server_arguments,
    server_environment,
    settings_table,
    warnings_of,
)
from streamdash.config import ConfigError
from streamdash.observe.table import UploadLimit
from streamdash.settings import PREFIX
from streamdash.simulation.limits import Limits, open_scheduler
from tests.waiting import PATIENCE_S

DOCS = Path(__file__).resolve().parents[2] / "docs" / "deployment.md"
SECRET = "0123456789abcdef0123456789abcdef"
PASSWORD = "Open, Sesame 9"


def settings(**variables: str) -> Deployment:
    with pytest.MonkeyPatch.context() as environment:
        for name, value in variables.items():
            environment.setenv(PREFIX + name.upper(), value)
        return Deployment()


# --- who may connect --------------------------------------------------------------------------


def origins(environment: dict[str, str] | None = None, **variables: str) -> list[str]:
    words = server_arguments(settings(**variables), False, environment or {})
    return [b for a, b in zip(words, words[1:], strict=False) if a == "--allow-websocket-origin"]


def test_who_may_connect():
    assert origins() == ["localhost:5006", "127.0.0.1:5006"]
    assert origins(port="80", address="10.0.0.7") == ["localhost:80", "127.0.0.1:80", "10.0.0.7:80"]
    assert origins(port="80", address="0.0.0.0") == ["localhost:80", "127.0.0.1:80"]
    assert origins(address="0.0.0.0", origins="a.example.org, b.example.org:8443") == [
        "a.example.org",
        "b.example.org:8443",
    ]
    assert origins({"BOKEH_ALLOW_WS_ORIGIN": "streams.example.org"}, address="0.0.0.0") == []


def test_what_is_given_on_the_command_line_wins(monkeypatch):
    monkeypatch.setenv("STREAMDASH_PORT", "8000")
    monkeypatch.setenv("STREAMDASH_ADDRESS", "0.0.0.0")
    assert Deployment().port == 8000
    assert Deployment(port=9000).port == 9000
    assert Deployment(port=9000).address == "0.0.0.0"


@pytest.mark.parametrize(
    ("address", "public"),
    [
        ("localhost", False),
        ("127.0.0.1", False),
        ("::1", False),
        ("0.0.0.0", True),
        ("", False),
        ("me", True),
    ],
)
def test_what_other_machines_can_reach(address, public):
    assert settings(address=address).is_public is public  # an empty variable leaves the default


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("variables", "named"),
    [
        ({"port": "0"}, "STREAMDASH_PORT"),
        ({"port": "http"}, "STREAMDASH_PORT"),
        ({"origins": "https://streams.example.org"}, "STREAMDASH_ORIGINS"),
        ({"prefix": "streams"}, "STREAMDASH_PREFIX"),
        ({"behind_proxy": "perhaps"}, "STREAMDASH_BEHIND_PROXY"),
    ],
)
def test_wrong_values_name_their_variable(variables, named):
    with pytest.raises(ConfigError, match=f"^{named}: .*{re.escape(next(iter(variables.values())))}"):
        settings(**variables)


OAUTH = {
    f"PANEL_OAUTH_{name}": "x" * 20 for name in ("PROVIDER", "KEY", "SECRET", "REDIRECT_URI", "ENCRYPTION")
}


@pytest.mark.parametrize(
    ("variables", "environment", "reason"),
    [
        ({"origins": "*", "address": "0.0.0.0"}, {}, "every website"),
        ({"origins": "*", "behind_proxy": "1"}, {}, "every website"),
        ({"origins": "*", "password": PASSWORD}, {}, "every website"),
        ({"password": "short"}, {}, "STREAMDASH_PASSWORD is shorter"),
        ({"secret": "short"}, {}, "STREAMDASH_SECRET is shorter"),
        ({"password": PASSWORD}, OAUTH, "both set"),
        ({"password": PASSWORD, "address": "0.0.0.0"}, {}, "unencrypted"),
        ({"address": "0.0.0.0"}, OAUTH, "unencrypted"),
        ({}, {"PANEL_OAUTH_PROVIDER": "github", "PANEL_OAUTH_KEY": "k"}, "PANEL_OAUTH_SECRET"),
        ({}, {"PANEL_BASIC_AUTH": PASSWORD}, "lower case"),
        ({"address": "0.0.0.0"}, {"BOKEH_SIGN_SESSIONS": "no"}, "signed sessions off"),
        ({"tls_key": __file__}, {}, "only work together"),
        ({"tls_key": __file__, "tls_certificate": "/none/such.pem"}, {}, "there is no file"),
    ],
)
def test_unsafe_combinations_are_refused_with_the_reason(variables, environment, reason):
    with pytest.raises(InputError, match=reason):
        check(settings(**variables), environment)


@pytest.mark.parametrize(
    ("variables", "environment"),
    [
        ({}, {}),
        ({"address": "0.0.0.0"}, {}),
        ({"origins": "*"}, {}),
        ({"password": PASSWORD}, {}),
        ({"password": PASSWORD, "address": "0.0.0.0", "behind_proxy": "1"}, {}),
        ({"password": PASSWORD, "address": "0.0.0.0", "tls_key": __file__, "tls_certificate": __file__}, {}),
        ({"secret": SECRET, "origins": "streams.example.org", "behind_proxy": "yes"}, OAUTH),
    ],
)
def test_safe_combinations_are_not(variables, environment):
    check(settings(**variables), environment)


@pytest.mark.parametrize(
    ("variables", "environment", "warned"),
    [
        ({}, {}, False),
        ({"address": "127.0.0.1"}, {}, False),
        ({"address": "0.0.0.0"}, {}, True),
        ({"address": "streams.example.org", "port": "8123"}, {}, True),
        ({"address": "0.0.0.0", "password": PASSWORD}, {}, False),
        ({"address": "0.0.0.0"}, {"PANEL_OAUTH_PROVIDER": "github"}, False),
    ],
)
def test_a_server_that_everyone_can_use_says_so(variables, environment, warned):
    said = warnings_of(settings(**variables), environment)
    assert bool(said) == warned
    assert all("Everyone" in s and variables.get("port", "5006") in s for s in said)


def test_a_scheduler_on_the_network_is_warned_of_unless_it_is_asked_by_tls():
    quiet = (
        "",
        "tcp://127.0.0.1:8786",
        "tcp://[::1]:8786",
        "localhost:8786",
        "tls://cluster.example.org:8786",
        "inproc://10.0.0.7/1/2",
    )
    assert [address for address in quiet if open_scheduler(address)] == []
    loud = (
        "tcp://10.0.0.7:8786",
        "cluster.example.org:8786",
        "tcp://[fd00::7]:8786",
        "ucx://10.0.0.7:1",
        "ws://10.0.0.7:1",
        "tcp://0.0.0.0:8786",
        "tcp://localhost.example.org:1",
        "tcp://127.0.0.1@10.0.0.7:8786",
    )
    assert [address for address in loud if address not in open_scheduler(address)] == []


def test_sessions_are_signed_always():
    first, second = (server_environment(settings(), {}) for _ in range(2))
    assert first["BOKEH_SIGN_SESSIONS"] == "yes"
    assert len(first["BOKEH_SECRET_KEY"]) >= 32
    assert first["BOKEH_SECRET_KEY"] != second["BOKEH_SECRET_KEY"]
    given = server_environment(settings(secret=SECRET), {})
    assert given["BOKEH_SECRET_KEY"] == SECRET
    assert given["PANEL_COOKIE_SECRET"] not in (SECRET, first["PANEL_COOKIE_SECRET"])
    assert given == server_environment(settings(secret=SECRET), {})


def test_secrets_are_not_printed():
    printed = str(settings_table(settings(secret=SECRET, password=PASSWORD)))
    assert SECRET not in printed
    assert PASSWORD not in printed
    assert PASSWORD not in " ".join(server_arguments(settings(password=PASSWORD), False, {}))


def test_the_documentation_lists_every_variable_with_its_default_and_meaning():
    text = DOCS.read_text(encoding="utf-8")
    for name, value, meaning in chain(*map(settings_table, (settings(), Limits(), UploadLimit()))):
        assert f"| `{name}` | {value or 'none'} | {meaning} |" in text


@pytest.mark.parametrize("text", ["0", "-1", "1.5", "nan", "a lot"])
def test_uploads_cannot_be_larger_than_what_is_read(text, monkeypatch):
    monkeypatch.setenv("STREAMDASH_MAX_UPLOAD_MB", text)
    with pytest.raises(ConfigError, match=f"^STREAMDASH_MAX_UPLOAD_MB: .*got '{text}'"):
        UploadLimit()


# --- a real server ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def running(small_cache) -> Callable[..., AbstractContextManager[str]]:
    """Start a server of few streams, with these environment variables, on a free port; gives its address."""
    return lambda **variables: _running(STREAMDASH_CACHE=str(small_cache), **variables)


@contextlib.contextmanager
def _running(**variables: str) -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    serve = [sys.executable, "-m", "streamdash.cli.main", "serve"]
    command = [*serve, "--port", str(port), "--address", "127.0.0.1"]
    server = subprocess.Popen(
        command, env={**os.environ, **variables}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    address = f"http://127.0.0.1:{port}"
    try:
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                with urllib.request.urlopen(f"{address}/liveness", timeout=PATIENCE_S) as answer:
                    assert answer.status == 200
                    break
            except OSError:
                assert server.poll() is None, server.stdout.read()
                assert time.monotonic() < deadline
                time.sleep(0.2)
        yield address
        server.send_signal(signal.SIGTERM)
        server.wait(PATIENCE_S)
        with pytest.raises(OSError, match="refused"):
            urllib.request.urlopen(f"{address}/liveness", timeout=PATIENCE_S)
    finally:
        if server.poll() is None:
            server.kill()
        server.communicate()


def visit(address: str, password: str) -> str:
    """Where a visitor who gives `password` ends up."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(http.cookiejar.CookieJar()))
    with opener.open(f"{address}/main", timeout=PATIENCE_S) as answer:
        assert urllib.parse.urlsplit(answer.url).path == "/login"
    form = urllib.parse.urlencode({"username": "anyone", "password": password}).encode()
    opener.open(f"{address}/login", form, timeout=PATIENCE_S).close()
    with opener.open(f"{address}/main", timeout=PATIENCE_S) as answer:
        return urllib.parse.urlsplit(answer.url).path


def test_a_password_keeps_others_out(running):
    with running(STREAMDASH_PASSWORD=PASSWORD) as address:
        assert visit(address, PASSWORD) == "/main"
        assert visit(address, PASSWORD.lower()) == "/login"
        assert visit(address, "") == "/login"
        with pytest.raises(OSError, match="403"):
            pull_session(url=f"{address}/main")


def answers(address: str, path: str = "/main", data: bytes | None = None) -> tuple[int, Message]:
    """Status and headers of an answer, redirects not followed."""
    parts = urllib.parse.urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=PATIENCE_S)
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    connection.request("POST" if data else "GET", path, data, form if data else {})
    answer = connection.getresponse()
    answer.read()
    connection.close()
    return answer.status, answer.headers


def test_guessing_passwords_is_slowed_down_and_cookies_stay_at_home(running):
    def guess(password: str) -> tuple[int, Message]:
        form = urllib.parse.urlencode({"username": "anyone", "password": password}).encode()
        return answers(address, "/login", form)

    with running(STREAMDASH_PASSWORD=PASSWORD) as address:
        status, found = guess(PASSWORD)
        assert status == 302
        cookies = [c for c in found.get_all("Set-Cookie") if not c.split("=", 1)[1].startswith('"";')]
        assert {cookie.split("=")[0] for cookie in cookies} == {"user", "id_token"}
        assert all("SameSite=Lax" in cookie and "HttpOnly" in cookie for cookie in cookies)
        statuses = [guess(f"wrong {i}")[0] for i in range(200)]
        assert statuses[:5] == [302] * 5
        assert statuses.count(429) >= 185  # how many get through depends on how long 200 take
        status, found = guess(PASSWORD)  # not even the right one, until the lock has ended
        assert status == 429
        assert int(found["Retry-After"]) >= 1


def test_every_answer_has_its_headers_and_sessions_of_ones_own_making_are_refused(running):
    with running(STREAMDASH_EMBEDDED_IN="https://course.example.org") as address:
        for path in ("/main", "/liveness", "/static/js/bokeh.min.js", "/nothing/here"):
            _, found = answers(address, path)
            assert found["X-Content-Type-Options"] == "nosniff", path
            assert found["Referrer-Policy"] == "same-origin"
            assert "Server" not in found
            policy = dict(part.split(" ", 1) for part in found["Content-Security-Policy"].split("; "))
            assert policy["frame-ancestors"] == "'self' https://course.example.org"
            assert policy["default-src"] == "'self'"
            assert "http" not in policy["script-src"] + policy["connect-src"]
        with pytest.raises(OSError, match="Disconnected with error code"):
            pull_session(session_id="mine", url=f"{address}/main")
