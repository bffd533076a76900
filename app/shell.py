"""The frame around the pages: navigation, light/dark, messages, address bar, and who is shown."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from typing import Any

import panel as pn

from app import ui
from app.page import Page
from app.services.services import Services, Unavailable
from app.session.session import Session
from app.ui.browser import AddressBar, Navigation
from app.ui.figure_tools import FigureTools
from streamdash.store.cache import StoreError

logger = logging.getLogger(__name__)

VISITOR = re.compile(r"[0-9a-f]{32}")
STRUCTURE = frozenset({"page", "stream", "mass"})
"""Changes that need a page to be built anew rather than patched."""


class Shell:
    """One browser session's app.

    It alone watches the session: a change is either handed to the open page (`Page.update`, inside
    one ``pn.io.hold()``) or, for `STRUCTURE`, answered by closing the page and building the one
    that is wanted.

    Parameters
    ----------
    session, services
        Passed on to the pages.
    pages
        The registry, in the navigation's order.
    soon
        Called with what builds the first page; at once when not given.
    """

    def __init__(
        self,
        session: Session,
        services: Services,
        pages: Sequence[type[Page]],
        soon: Callable[[Callable[[], Any]], Any] = lambda build: build(),
    ) -> None:
        self.session = session
        self.services = services
        self.pages = {page.key: page for page in pages}
        self.page: Page | None = None
        self.address = AddressBar(search=session.search, visitor=session.visitor, width=0, height=0, margin=0)
        self.messages = pn.Column(margin=0, sizing_mode="stretch_width")
        self.slot = pn.Column(sizing_mode="stretch_width", margin=0)
        self.navigation = Navigation(groups=_groups(pages), page=self.key, css_classes=["sd-nav"])
        self.view = ui.page_frame(
            [self.address, FigureTools(width=0, height=0, margin=0), self.messages, self.slot],
            session.dark,
            [self.navigation],
        )
        self._say_problems()
        soon(self._show)
        session.param.watch(self._changed, [n for n in session.param if n not in ("name", "problems")])
        session.param.watch(lambda _: self._say_problems(), ["problems", "catalog"])
        self.navigation.param.watch(self._navigated, "page")
        self.view.param.watch(self._toggled, "dark_theme")
        self.address.param.watch(self._moved_in_history, "search")
        self.address.param.watch(self._returned, "visitor")
        self.address.param.watch(lambda event: session.param.update(system_dark=event.new), "dark")

    @property
    def key(self) -> str:
        """Key of the page that is wanted; the first where the session names none."""
        return self.session.page or next(iter(self.pages))

    def _navigated(self, event: Any) -> None:
        if event.new == self.key:
            return
        if event.new in self.pages:
            self.session.page = event.new
        else:  # a hand-made message from the browser
            self.navigation.page = self.key

    def _toggled(self, event: Any) -> None:
        if event.new != self.session.dark:
            own = {True: "dark", False: "light"}[event.new]
            self.session.theme = "default" if event.new == self.session.system_dark else own

    def _moved_in_history(self, event: Any) -> None:
        if event.new != self.session.search:
            self.session.load(event.new)

    def _returned(self, event: Any) -> None:
        """The tab was loaded anew: what it has started is still its own."""
        if VISITOR.fullmatch(event.new):
            self.session.visitor = event.new

    def _changed(self, *events: Any) -> None:
        changed = frozenset(event.name for event in events)
        if "system_dark" in changed:
            changed |= {"theme"}
        with pn.io.hold():
            self.navigation.page = self.key
            if changed & STRUCTURE:
                self._show()
            elif self.page is not None and changed & self.page.uses:
                page = self.page
                self._attempt(lambda: page.update(changed & page.uses))
            self.view.dark_theme = self.session.dark
            if "page" in changed:
                self.address.push += 1
            self.address.search = self.session.search

    def _show(self) -> None:
        """Close the page that is open and build the one that is wanted."""
        self.close()
        slot = self.slot
        slot.clear()
        wanted = self.pages[self.key]
        if wanted.needs_ensembles and not self.session.ensembles:
            slot[:] = [ui.no_ensembles()]
            return
        stream, caveats = self.session.catalog.stream(self.session.stream), []
        if wanted.needs_ensembles and stream is not None:
            if stream.arms and wanted.one_arm:
                slot[:] = [ui.one_arm(stream, wanted.one_arm, self.session.choose_stream)]
                return
            caveats = [ui.stream_caveats(stream.model)]
        page = self.page = wanted(self.session, self.services)
        self._attempt(lambda: slot.extend([page.view(), *caveats]))

    def _attempt(self, action: Callable[[], Any]) -> None:
        """Run a page's code; what goes wrong becomes a sentence, never a traceback in the page."""
        try:
            action()
        except (Unavailable, StoreError) as error:
            sentence = str(error)
        except Exception:
            logger.exception("page %r failed", self.key)
            sentence = "This page failed unexpectedly; the server's log has the details."
        else:
            return
        self._abandon()
        self.slot[:] = [ui.error_state(sentence)]

    def _abandon(self) -> None:
        """Let go of a page that has failed, perhaps before it had all that its `close` ends."""
        page, self.page = self.page, None
        if page is not None:
            try:
                page.close()
            except AttributeError:
                Page.close(page)

    def _say_problems(self) -> None:
        sentences = [*self.session.problems, *self.session.catalog.problems]
        self.messages[:] = [ui.message(sentences, "warning")] if sentences else []

    def close(self) -> None:
        """Close the open page; the server calls this when the browser has gone."""
        if self.page is not None:
            self.page.close()
            self.page = None


def _groups(pages: Sequence[type[Page]]) -> list[Any]:
    """Pages as `Navigation` takes them: those of a group together; the first is behind the app's name."""
    groups: dict[str, list[list[str]]] = {}
    for page in pages[1:]:
        groups.setdefault(page.group, []).append([page.key, page.title])
    return [[name, listed] for name, listed in groups.items()]
