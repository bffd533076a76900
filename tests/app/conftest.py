"""The app without a browser: sessions and pages on the shipped cache."""

from __future__ import annotations

import uuid
from collections.abc import Iterator

import panel as pn
import pytest
from bokeh.server.server import Server

from app.pages.registry import PAGES
from app.services.services import Services
from app.serving import open_session
from app.session.session import Session
from app.shell import Shell
from streamdash.simulation.limits import Limits
from streamdash.store.cache import Cache
from tests.waiting import wait_until


@pytest.fixture(scope="session")
def services(shipped_cache) -> Services:
    """Services of one server process on the shipped cache."""
    return Services(Cache.default(shipped_cache), limits=Limits(nice=0))


@pytest.fixture
def open_shell(services):
    """Open the app at a link, as one browser session would."""

    def open_at(search: str = "") -> Shell:
        session = Session(tuple(page.key for page in PAGES), services.catalog())
        session.load(search)
        return Shell(session, services, PAGES)

    return open_at


@pytest.fixture
def server(services) -> Iterator[Server]:
    """A server in this process that forgets unused sessions at once."""
    server_id = uuid.uuid4().hex
    thread = pn.serve(
        {"main": lambda: open_session(services)},
        port=0,
        threaded=True,
        show=False,
        verbose=False,
        server_id=server_id,
        check_unused_sessions_milliseconds=100,
        unused_session_lifetime_milliseconds=100,
    )
    wait_until(lambda: server_id in pn.state._servers)
    yield pn.state._servers[server_id][0]
    thread.stop()
