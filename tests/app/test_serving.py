"""A session as the server builds it, whichever way a browser came to it."""

from __future__ import annotations

import pytest
from bokeh.client import pull_session
from bokeh.models.css import ImportedStyleSheet

from app.services.services import Services
from streamdash.store.cache import Cache


@pytest.fixture(scope="module")
def services(small_cache) -> Services:
    """Services of a server on few streams."""
    return Services(Cache.default(small_cache))


def test_a_session_that_comes_back_without_its_page_asks_no_other_host(server):
    """After a break of the connection a browser asks for a session by WebSocket alone."""
    client = pull_session(url=f"http://localhost:{server.port}/main")
    try:
        sheets = {str(sheet.url) for sheet in client.document.select({"type": ImportedStyleSheet})}
    finally:
        client.close()
    assert sheets
    assert [url for url in sheets if "//" in url] == []
