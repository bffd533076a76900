"""What every page of the app has in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from panel.viewable import Viewable

from app.services.services import Services
from app.session.session import Session


class Page:
    """One page, made when a session opens it and closed when the session leaves it.

    Parameters
    ----------
    session
        What this browser session has chosen; widgets bind to its parameters.
    services
        What all sessions of the process share.

    Raises
    ------
    Unavailable
        From ``__init__``, `view` or `update`: the shell shows the sentence instead of the page.
    """

    key: ClassVar[str]
    """Name in links (``?page=key``)."""
    title: ClassVar[str]
    """Name in the navigation."""
    group: ClassVar[str] = ""
    """Group of the navigation it stands in."""
    question: ClassVar[str] = ""
    """What the page answers: its heading."""
    uses: ClassVar[frozenset[str]] = frozenset()
    """Names of the `Session` parameters that `update` wants to hear about."""
    needs_ensembles: ClassVar[bool] = True
    """Whether the page has nothing to show while the cache holds no complete ensemble."""

    one_arm: ClassVar[str] = ""
    """Why the page takes the arms of a stream one by one, and what to do; empty where it takes both."""

    bundled: list[Any]
    """Its figures (`app.ui.cards.FigureCard`), as they were made."""

    def __init__(self, session: Session, services: Services) -> None:
        self.session = session
        self.services = services
        self.bundled = []
        self._watchers: list[Any] = []

    def view(self) -> Viewable:
        """The page's content; called once."""
        raise NotImplementedError

    def update(self, changed: frozenset[str]) -> None:
        """Patch what is shown after `session` changed.

        The shell calls this on the session's event loop inside one ``pn.io.hold()``, so that all
        figures change in one message. ``changed`` holds the names from `uses` that changed.
        """

    def bind(
        self,
        name: str,
        widget: Any,
        to_widget: Callable[[Any], Any] = lambda value: value,
        to_session: Callable[[Any], Any] = lambda value: value,
    ) -> Any:
        """Keep ``widget.value`` and a session parameter equal until the page closes.

        A value the session refuses (a hand-made message from the browser) puts the widget back.
        """
        session = self.session
        widget.value = to_widget(getattr(session, name))

        def from_widget(event: Any) -> None:
            try:
                setattr(session, name, to_session(event.new))
            except (ValueError, TypeError):
                widget.value = to_widget(getattr(session, name))

        def from_session(event: Any) -> None:
            # Not what the widget just said, only rounded: an echo would pull a slider back.
            if to_session(widget.value) != event.new:
                widget.value = to_widget(event.new)

        widget.param.watch(from_widget, "value")
        self._watchers.append(session.param.watch(from_session, name))
        return widget

    def follow(self, name: str, action: Callable[[], Any]) -> None:
        """Call ``action()`` whenever a session parameter has changed, until the page closes."""
        self._watchers.append(self.session.param.watch(lambda _: action(), name))

    def close(self) -> None:
        """Let go of the session; derived pages also stop timers and jobs here, then call this."""
        for watcher in self._watchers:
            self.session.param.unwatch(watcher)
        self._watchers.clear()
