"""The Infer page's one panel of controls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from app import ui
from app.page import Page
from app.pages.infer.answers import Oracle
from app.pages.observe.parts import AssumptionControls
from app.pages.observe.reading import kept_name
from app.session.session import Session
from app.ui.browser import LiveText
from app.ui.study import TaskControls
from app.ui.upload import FileDrop

KEPT_WORDS = (
    "The file stays in this session’s memory; of what is trained for it, the bins and errors are kept, "
    "not its values."
)


class Controls:
    """Stream, prior and data; then errors, age and stretch; then what trains and puts aside.

    Parameters
    ----------
    page
        Its session is bound.
    receive, refuse, announce
        What `FileDrop` calls.
    example, train, cancel, keep, other
        What the buttons call.
    """

    def __init__(
        self,
        page: Page,
        *,
        receive: Callable[[bytes], None],
        refuse: Callable[[str], None],
        announce: Callable[[str], None],
        example: Callable[[], None],
        train: Callable[[], None],
        cancel: Callable[[], None],
        keep: Callable[[], None],
        other: Callable[[], None],
    ) -> None:
        self.session: Session = page.session
        wide: dict[str, Any] = {"sizing_mode": ui.WIDE, "width": None}
        self.number = ui.int_slider(page, "infer_number", "Which one", **wide)
        options = self._ensembles()
        self.ensembles = page.bind("infer_class", ui.menu("infer_class", "Ensemble", options, **wide))
        self.errors = ui.slider(page, "infer_errors", "Errors × the usual ones", **wide)
        self.ages = ui.toggle(page, "infer_age", "Age of the stream (Gyr)", _age_options(None))
        self.age_buttons: Any = self.ages.objects[1]  # type: ignore[attr-defined]
        self.window = ui.toggle(page, "infer_window", "Stretch that is used")
        self.assumptions = AssumptionControls(page.session)
        self.status = LiveText(margin=(0, 10), css_classes=["sd-infer-status"])
        self.drop = FileDrop(
            receive,
            refuse,
            limit=int(1e6 * page.services.uploads.max_upload_mb),
            announce=announce,
            kept=kept_name(page.session),
            sizing_mode=ui.WIDE,
            margin=(6, 10),
            css_classes=["sd-drop"],
        )
        self.about_files = ui.plain_text(KEPT_WORDS, margin=(0, 10))
        self.example = ui.button("Try the example", example, css_classes=["sd-example"], margin=(4, 10))
        self.training = TaskControls("Train for these bins", train, cancel, "infer", color="primary")
        self.keep = ui.button("Put aside, to join", keep, css_classes=["sd-infer-keep"], margin=(4, 10))
        self.kept = LiveText(margin=(0, 10), css_classes=["sd-infer-kept"])
        self.other = ui.button(
            "Other arm", other, css_classes=["sd-infer-other"], margin=(4, 10), visible=False
        )
        key = [ui.stream_picker(page), ui.select(page, "infer_prior", "Prior: what is left open", **wide)]
        more = [
            ui.toggle(page, "infer_data", "Data"),
            self.ensembles,
            self.number,
            self.drop,
            self.about_files,
            self.example,
            self.status,
            self.assumptions.view,
            self.errors,
            self.ages,
            self.window,
            self.training.view,
            self.keep,
            self.kept,
            self.other,
        ]
        self.view = ui.side_panel(key, more)

    def arrange(self, base: Oracle | None, halvable: bool, window: str) -> None:
        """Show those that mean something for the data that are chosen, and for who answers."""
        data = self.session.infer_data
        own = data == "upload"
        for part in (self.drop, self.about_files, self.example, self.status, self.assumptions.view):
            part.visible = own
        self.number.visible = not own
        self.window.visible = halvable
        self.ensembles.visible = data == "simulated"
        told = base is not None and base.told and not own and window == "whole"
        self.errors.visible = self.ages.visible = told
        options = _age_options(base)
        if self.age_buttons.options != options:
            self.age_buttons.options = options

    def say_kept(self, names: Sequence[str], other: str) -> None:
        """Say what was put aside, and offer the other arm of the stream, where there is one."""
        self.kept.text = f"Put aside: {'; '.join(names)}." if names else ""
        self.other.visible = bool(other)
        self.other.label = f"Next: the {other} arm"

    def _ensembles(self) -> dict[str, int]:
        stream = self.session.catalog.stream(self.session.stream)
        return {choice.label: i for i, choice in enumerate(stream.ensembles if stream else ())}


def _age_options(base: Oracle | None) -> dict[str, str]:
    """Ages by what is read; the stream's own is what a link need not say."""
    usual = base.estimator.stream.age_gyr if base else None
    ages = {f"{age:g}": "usual" if age == usual else f"{age:g}" for age in (base.ages if base else ())}
    return {**(ages or {"usual": "usual"}), "unknown": "open"}
