"""Sessions that end are freed: opened, used and closed on a real server, they leave nothing alive."""

from __future__ import annotations

import gc
from collections import Counter

import panel as pn
import pytest
from bokeh.client import pull_session
from bokeh.document import Document
from bokeh.server.server import Server
from panel.util import edit_readonly

from app import ui
from app.pages.profiles.page import ProfilesPage
from app.services.services import Services
from app.session.session import Session
from app.shell import Shell
from app.ui import frame
from streamdash.plots.live import LiveFigure
from streamdash.store.cache import Cache
from tests.waiting import wait_until

KINDS = (Session, Shell, ProfilesPage, LiveFigure, Document, frame.pmui.Page)


def alive() -> dict[str, int]:
    """Live objects of each kind that belongs to one browser session."""
    gc.collect()
    types = Counter(map(type, gc.get_objects()))
    return {kind.__name__: sum(n for one, n in types.items() if issubclass(one, kind)) for kind in KINDS}


@pytest.fixture(scope="module")
def services(small_cache) -> Services:
    """Services of a server on few streams: sessions are what is looked at."""
    return Services(Cache.default(small_cache))


def use_and_close(server: Server) -> None:
    """Open a session as a browser does, move its noise slider, and leave."""
    client = pull_session(url=f"http://localhost:{server.port}/main")
    slider = next(
        model
        for model in client.document.models
        if "Shot noise" in str(getattr(getattr(model, "data", None), "label", ""))
    )
    slider.data.value = 0.5
    client.force_roundtrip()
    client.close()


@pytest.mark.parametrize("sessions", [4, pytest.param(200, marks=pytest.mark.slow)])
def test_sessions_that_end_are_freed(server, sessions):
    others, now = alive(), {}  # earlier tests of this process may not have let go of everything

    def freed(*kinds: str) -> bool:
        if server.get_sessions("/main"):
            return False
        now.update(alive())
        return all(now[kind] <= others[kind] for kind in kinds)

    use_and_close(server)
    wait_until(lambda: freed("Shell"), "the first session stays", 0.5)
    others["Document"] = now["Document"]  # the server keeps one of its own
    for _ in range(sessions):
        use_and_close(server)
    wait_until(lambda: freed(*others), {"before": others, f"after {sessions} sessions": now}, 0.5)


def test_a_page_does_not_follow_the_busy_flag_of_the_process():
    page = ui.page_frame([], dark=False)
    with edit_readonly(pn.state):
        pn.state.busy = True
        followed = page.busy
        pn.state.busy = False
    assert not followed
