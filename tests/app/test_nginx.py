"""Two server processes behind nginx, with the configuration that docs/deployment.md gives."""

from __future__ import annotations

import asyncio
import http.cookiejar
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from tests.waiting import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]


def free_ports(n: int) -> list[int]:
    probes = [socket.socket() for _ in range(n)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


def wait_for(url: str, processes: list[subprocess.Popen]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
                assert answer.status == 200
                return
        except OSError:
            assert all(process.poll() is None for process in processes)
            assert time.monotonic() < deadline, f"{url} does not answer"
            time.sleep(0.2)


@pytest.fixture
def site(shipped_cache, tmp_path):
    """Address of nginx, and the two servers behind it."""
    nginx = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
    assert nginx, "nginx is missing; install it with: apt-get install -y nginx-light"
    front, first, second = free_ports(3)
    text = (ROOT / "docs" / "nginx.conf").read_text(encoding="utf-8")
    for old, new in (("5101", first), ("5102", second), ("8080", f"127.0.0.1:{front}")):
        text = text.replace(old, str(new))
    (tmp_path / "nginx.conf").write_text(text, encoding="utf-8")
    environment = {
        **os.environ,
        "STREAMDASH_CACHE": str(shipped_cache),
        "STREAMDASH_ORIGINS": f"127.0.0.1:{front}",
        "STREAMDASH_BEHIND_PROXY": "1",
        "STREAMDASH_SECRET": "one secret for both of the processes",
    }
    serve = [sys.executable, "-m", "streamdash.cli.main", "serve", "--address", "127.0.0.1", "--port"]
    servers = [subprocess.Popen([*serve, str(port)], env=environment, cwd=ROOT) for port in (first, second)]
    command = [nginx, "-p", str(tmp_path), "-c", str(tmp_path / "nginx.conf"), "-g", "daemon off;"]
    front_process = subprocess.Popen(command)
    try:
        for port in (first, second, front):
            wait_for(f"http://127.0.0.1:{port}/liveness", [*servers, front_process])
        yield f"127.0.0.1:{front}", servers
    finally:
        for process in (front_process, *servers):
            process.terminate()
        for process in (front_process, *servers):
            process.wait(PATIENCE_S)


def visit(address: str, jar: http.cookiejar.CookieJar) -> str:
    """Open the page as a browser does; gives its session token."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(jar))
    with opener.open(f"http://{address}/main", timeout=PATIENCE_S) as answer:
        page = answer.read().decode()
    return re.search(r'"token":\s*"([^"]+)"', page).group(1)


def process_of(jar: http.cookiejar.CookieJar) -> str:
    return next(cookie.value for cookie in jar if cookie.name == "streamdash")


def cookies(jar: http.cookiejar.CookieJar) -> str:
    return "; ".join(f"{cookie.name}={cookie.value}" for cookie in jar)


async def acknowledged(address: str, jar: http.cookiejar.CookieJar, token: str) -> bool:
    """Whether the session of `token` answers on its WebSocket."""
    request = HTTPRequest(
        f"ws://{address}/main/ws", headers={"Cookie": cookies(jar), "Origin": f"http://{address}"}
    )
    connection = await websocket_connect(request, subprotocols=["bokeh", token])
    header = await asyncio.wait_for(connection.read_message(), PATIENCE_S)
    connection.close()
    return json.loads(header)["msgtype"] == "ACK"


def sent_to(process: str) -> http.cookiejar.CookieJar:
    """Cookies of a visitor who has been sent to `process` before."""
    jar = http.cookiejar.CookieJar()
    jar.set_cookie(
        http.cookiejar.Cookie(
            0, "streamdash", process, None, False, "127.0.0.1", True, False, "/", True, False, None, True,
            None, None, {},
        )
    )  # fmt: skip
    return jar


@pytest.mark.slow
def test_visitors_keep_their_process_and_move_when_it_is_gone(site):
    address, servers = site
    new = http.cookiejar.CookieJar()
    old = {process: sent_to(process) for process in ("one", "two")}
    for jar in (new, *old.values()):
        token = visit(address, jar)
        assert asyncio.run(acknowledged(address, jar, token))
    assert process_of(new) in old
    assert [process_of(jar) for jar in old.values()] == list(old)
    servers[0].kill()
    servers[0].wait()
    token = visit(address, old["one"])
    assert asyncio.run(acknowledged(address, old["one"], token))
