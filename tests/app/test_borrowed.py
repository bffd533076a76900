"""What other libraries do not promise is still there, and does what the app uses it for."""

import panel as pn
import panel_material_ui as pmui
from panel.auth import BasicAuthProvider
from panel.reactive import Syncable

from app.borrowed import component_code, forget_view, gather_events_for, sign_in_pages, unwatch_busy


def test_code_of_components_comes_from_this_server():
    address = component_code().partition("?")[0]
    assert address.startswith("./static/")
    assert address.endswith(".js")


def test_a_page_that_is_unwatched_leaves_nothing_behind_in_the_process():
    def watchers():
        found = pn.state.param.watchers.get("busy", {}).get("value", [])
        return [watcher for watcher in found if "busy" in watcher.parameter_names]

    before = len(watchers())
    page = pmui.Page(title="a page")
    unwatch_busy(page)
    assert len(watchers()) == before
    assert not any("busy" in names for names, _ in page._param__private.ref_watchers)


def test_a_view_is_forgotten_and_others_are_not():
    mine, other = object(), object()
    views = {"forgotten": (mine, None, None, None), "kept": (other, None, None, None)}
    pn.state._views.update(views)
    try:
        forget_view(mine)
        assert "forgotten" not in pn.state._views
        assert "kept" in pn.state._views
    finally:
        for ref in views:
            pn.state._views.pop(ref, None)


def test_events_of_one_widget_are_gathered_for_a_time_of_its_own():
    waited = []

    class Served:
        session_context = True

        def add_timeout_callback(self, _, milliseconds):
            waited.append(milliseconds)

    doc = Served()
    quick, usual = pmui.IntSlider(start=0, end=9), pmui.IntSlider(start=0, end=9)
    gather_events_for(quick, 7)
    for widget in (quick, usual):
        widget._server_change(doc, "ref", None, "value", 1, 2)
    assert waited == [7, Syncable._debounce]


def test_a_provider_tells_where_its_sign_in_is():
    provider = BasicAuthProvider(login_endpoint="/enter", logout_endpoint="/leave")
    pages = sign_in_pages(provider)
    assert pages["_login_endpoint"] == "/enter"
    assert pages["_login_template"] is not None
