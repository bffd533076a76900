"""What the app uses of other libraries though they do not promise it: all of it, each with its reason.

Nothing else in `app` reaches for a private name (ruff's SLF rule); ``app/guard.py`` puts right a function
that Bokeh does offer. The versions are bounded in pyproject.toml, and ``tests/app/test_borrowed.py``
fails when one of these stops working.
"""

from __future__ import annotations

from typing import Any

import panel as pn
import panel_material_ui as pmui
from panel.auth import BasicAuthProvider
from panel.viewable import Viewable


def component_code() -> str:
    """Address of the code of panel-material-ui's components, from this server.

    For the page to load it while the server still builds what it will show.
    """
    return str(pmui.Page._render_esm(server=True))


def unwatch_busy(page: pmui.Page) -> None:
    """Detach a page from the process-wide ``pn.state.busy``.

    panel-material-ui 0.16.6 binds every `Page` to it: each callback of any session then walks every
    session's model graph, and pages are never freed. The reference lives in param's private
    bookkeeping; ``tests/app/test_leaks.py`` fails when this stops working.
    """
    private = page._param__private
    private.refs = {name: ref for name, ref in private.refs.items() if name != "busy"}
    kept = []
    for names, watcher in private.ref_watchers:
        if "busy" in names:
            (watcher.cls if watcher.inst is None else watcher.inst).param.unwatch(watcher)
        else:
            kept.append((names, watcher))
    private.ref_watchers = kept


def forget_view(view: Any) -> None:
    """Drop the process-wide entry of a session's notification area.

    Panel 1.9.4 removes every other view of a session that ends but leaves this one, and with it
    the session's document; ``tests/app/test_leaks.py`` fails when it stays.
    """
    views = pn.state._views
    for ref in [ref for ref, (known, *_) in views.items() if known is view]:
        del views[ref]


def gather_events_for(widget: Viewable, milliseconds: int) -> None:
    """Set how long Panel gathers a widget's events before it answers them, for this one widget.

    Panel offers one number for all of them.
    """
    widget._debounce = milliseconds  # type: ignore[attr-defined]


def sign_in_pages(provider: BasicAuthProvider) -> dict[str, Any]:
    """Where a provider's sign-in is and what it looks like, as the attributes of its handler.

    Panel's provider sets them on its own handler only.
    """
    return {name: getattr(provider, name) for name in ("_login_endpoint", "_login_template")}
