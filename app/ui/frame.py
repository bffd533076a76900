"""The frame around all pages: title bar, theme, navigation. Works around a fault of panel-material-ui."""

from __future__ import annotations

from collections.abc import Sequence

import panel_material_ui as pmui
from panel.viewable import Viewable

from app.ui.layout import WIDE
from app.ui.theme import STYLE, TEMPLATE, THEME


def page_frame(main: Sequence[Viewable], dark: bool) -> pmui.Page:
    """Title bar with the light/dark switch around `main`; everything comes from this server."""
    page = pmui.Page(
        title="streamdash",
        meta_description="Which dark-matter perturbers made the gaps in a stellar stream?",
        main=list(main),
        dark_theme=dark,
        theme_config=THEME,
        raw_css=[STYLE],
        busy_indicator=None,
        site_url=".",
        main_width=1600,
        css_classes=["sd-page"],
        template=TEMPLATE % pmui.Page._render_esm(server=True),
    )
    unwatch_busy(page)
    return page


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


def navigation(pages: Sequence[tuple[str, Viewable]], active: int) -> pmui.Tabs:
    """The pages as tabs; only the open one is sent to the browser."""
    return pmui.Tabs(
        *pages,
        dynamic=True,
        active=active,
        sizing_mode=WIDE,
        margin=0,
        css_classes=["sd-nav"],
    )
