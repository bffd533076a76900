"""Cards: a figure with its sentence, files, pinned views and the code that makes it; texts that fold."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import pandas as pd
import panel as pn
import panel_material_ui as pmui
from markupsafe import escape
from panel.viewable import Viewable

from app.page import Page
from app.ui.about import about
from app.ui.browser import LiveText
from app.ui.bundle import bundle
from app.ui.layout import CARD, WIDE, figure_grid
from app.ui.links import Links
from app.ui.templates import Html, fill, from_markdown, subscripted
from streamdash.plots.files import About, publish
from streamdash.plots.legend import Mark

CODE_STYLE = "pre { margin: 0; padding: 4px 16px; overflow-x: auto; font-size: 13px; line-height: 1.45; }"
FORMULAS = frozenset("=+-@")
"""What a cell begins with that spreadsheets compute."""
UNMARKED = str.maketrans({c: f"\\{c}" for c in "*[]`<>"})
"""What Markdown would make something of in a heading of ours."""
DOCUMENT_STYLE = """
:host { font: 15px/1.55 Roboto, sans-serif; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
th, td { padding: 3px 8px; text-align: left; border-bottom: 1px solid #80808040; }
sub { font-size: 0.75em; line-height: 0; }
"""
IMAGES = ("png", "svg", "pdf")
"""Kinds of files of a figure."""
CONTROLS = re.compile(r"[\x00-\x1f\x7f]+")


def csv_of(table: pd.DataFrame) -> bytes:
    """A table as CSV that spreadsheets show: a text that they would compute begins with an apostrophe.

    Names of ensembles come from imported files, and ``=HYPERLINK(…)`` in a cell is a formula.
    """
    plain = table.rename(columns=_not_a_formula)
    for i in range(plain.shape[1]):
        if not pd.api.types.is_numeric_dtype(plain.dtypes.iloc[i]):
            plain.isetitem(i, [_not_a_formula(value) for value in plain.iloc[:, i]])
    return plain.to_csv(index=False, float_format="%.6g").encode()


def _not_a_formula(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    line = CONTROLS.sub(" ", value)  # a lone carriage return would begin a new row
    return f"'{line}" if line[:1] in FORMULAS and line[1:] else line


class FigureCard:
    """A figure with heading, sentence, downloads and the code that makes it.

    Parameters
    ----------
    title
        Heading.
    figures
        One Bokeh figure or Panel object, or several shown side by side.
    name
        Stem of the downloaded files' names; ``sd-card-<name>`` is the card's CSS class.
    drawn
        Returns the figure as it is now, declared for Matplotlib.
    table
        Returns the figure's numbers as they are now, units in the column names.
    code
        Returns the lines of Python that make the figure as it is now.
    legend
        Shown under the figure, and in its files.
    bare
        Whether heading, files and code are left out.
    page
        The page it stands on: its files name the classes, the settings and the link.

    Attributes
    ----------
    files : dict
        By kind (``png``, ``svg``, ``pdf``, ``csv``), what a download calls for its bytes.
    """

    def __init__(
        self,
        title: str,
        figures: Any,
        *,
        name: str,
        drawn: Callable[[], Any],
        table: Callable[[], pd.DataFrame],
        code: Callable[[], str],
        legend: Viewable | None = None,
        bare: bool = False,
        page: Page | None = None,
    ) -> None:
        self.code = code
        self.name = name
        self._title, self._page = title, page
        if page is not None:
            page.bundled.append(self)
        marks = getattr(legend, "marks", ())
        self._sentence = LiveText(sizing_mode=WIDE, margin=(4, 0, 0, 0), css_classes=["sd-sentence"])
        figures = figures if isinstance(figures, list | tuple) else [figures]
        heading = pmui.Typography(subscripted(title.translate(UNMARKED)), variant="h6", margin=0)
        self.files: dict[str, Callable[[], bytes]] = {
            **{kind: partial(self._image, kind, drawn, marks) for kind in IMAGES},
            "csv": lambda: self.about().comments.encode() + csv_of(table()),
        }
        self._opener = pmui.Button(
            label="⤓ Export",
            on_click=lambda _: self._toggle(),
            variant="text",
            size="small",
            margin=0,
            disabled=True,
            css_classes=["sd-export"],
            sx={"textTransform": "none", "minHeight": "32px"},
        )
        self._pinner = pmui.Button(
            label="Pin",
            on_click=lambda _: self.pin(),
            variant="text",
            size="small",
            margin=0,
            disabled=True,
            css_classes=["sd-pin"],
            description="Keep this view beside the next one",
            sx={"textTransform": "none", "minHeight": "32px"},
        )
        # Made when it is opened: few are, and a page with ten figures is there sooner.
        self._downloads: list[pmui.FileDownload] = []
        self._listing: Html | None = None
        self._bundle: pmui.FileDownload | None = None
        self._tray = pn.Column(sizing_mode=WIDE, margin=0, visible=False, css_classes=["sd-tray"])
        self._pinned = pn.Column(
            margin=0, visible=False, styles={"flex": "1 1 380px", "min-width": "0"}, css_classes=["sd-pinned"]
        )
        self._pins: dict[str, Any] = page.session.pinned if page is not None else {}
        self._show_pinned()
        head = pn.FlexBox(
            heading,
            pn.Row(self._pinner, self._opener, margin=0, styles={"flex": "none"}),
            align_items="center",
            justify_content="space-between",
            flex_wrap="nowrap",
            gap="4px 12px",
            sizing_mode=WIDE,
            margin=0,
        )
        self.view = pn.Column(
            *([] if bare else [head, self._tray]),
            pn.FlexBox(
                pn.Column(figure_grid(figures), margin=0, styles={"flex": "1 1 380px", "min-width": "0"}),
                self._pinned,
                gap="8px 12px",
                sizing_mode=WIDE,
                margin=0,
            ),
            *([legend] if legend else []),
            self._sentence,
            sizing_mode=WIDE,
            margin=(4, 0, 8, 0),
            styles=CARD,
            css_classes=["sd-card", f"sd-card-{name}"],
        )

    def say(self, sentence: str, *, ready: bool = True) -> None:
        """Set the sentence under the figure; also refreshes the code where it is open.

        The files can be had while there is a sentence, unless ``ready`` says otherwise:
        a figure that is not there yet has none.
        """
        self._sentence.text = sentence
        for file in (self._opener, self._pinner, *self._downloads):
            file.disabled = not (sentence and ready)
        self._list()

    def pin(self) -> None:
        """Keep the figure as it is now, with what it says, beside what controls will make of it."""
        about = self.about()
        alt = f"Pinned: {' '.join(about.caption)}. {self.words}"
        search = self._page.session.search if self._page is not None else ""
        self._pins[self.name] = (self.files["png"](), alt, self.words, search)
        self._show_pinned()

    def unpin(self) -> None:
        """Let go of what is pinned."""
        self._pins.pop(self.name, None)
        self._show_pinned()

    def _show_pinned(self) -> None:
        """The view that was pinned, also where the page was built anew since."""
        pinned = self._pins.get(self.name)
        self._pinned.visible = pinned is not None
        if pinned is None:
            self._pinned.clear()
            return
        image, alt, words, search = pinned
        ground = {"background": "#ffffff", "border-radius": "4px"}
        away = pmui.Button(
            label="Take the pinned view away",
            on_click=lambda _: self.unpin(),
            variant="text",
            size="small",
            margin=0,
            css_classes=["sd-unpin"],
            sx={"textTransform": "none", "minHeight": "32px"},
        )
        self._pinned[:] = [
            away,
            pn.pane.PNG(image, alt_text=alt, sizing_mode=WIDE, styles=ground),
            Html(words, margin=0, styles={"font": "14px/1.5 Roboto, sans-serif"}),
            Links(links=[["Show these settings again", search]], margin=0),
        ]

    @property
    def words(self) -> str:
        """The sentence under the figure."""
        return self._sentence.text

    @property
    def ready(self) -> bool:
        """Whether there is something to download."""
        return not self._opener.disabled

    def about(self) -> About:
        """What the files say of themselves now."""
        return about(self._page, self._title)

    def filename(self, kind: str) -> str:
        """Name of a file as it would be now: it tells figure, classes and settings."""
        return f"{self.about().stem(self.name)}.{kind}"

    def _image(self, kind: str, drawn: Callable[[], Any], marks: Sequence[Mark]) -> bytes:
        return publish(drawn(), kind, self.about(), marks)

    def _toggle(self) -> None:
        """Show or hide the files and the code."""
        if self._listing is None:
            self._downloads = [download(self.filename(kind), kind, make) for kind, make in self.files.items()]
            self._listing = Html(stylesheets=[CODE_STYLE], margin=0, css_classes=["sd-code"])
            everything = []
            if self._page is not None:
                page = self._page
                self._bundle = download(self._bundle_name(), "zip", lambda: bundle(page.bundled))
                self._bundle.label = "All of this page (ZIP)"
                everything.append(self._bundle)
            row = pn.FlexBox(*self._downloads, *everything, gap="4px", sizing_mode=WIDE, margin=0)
            self._tray[:] = [row, self._listing]
        self._tray.visible = not self._tray.visible
        self._list()

    def _bundle_name(self) -> str:
        key = self._page.key if self._page is not None else self.name
        return f"{self.about().stem(key)}.zip"

    def _list(self) -> None:
        if self._tray.visible and self._listing is not None:
            if self._bundle is not None:
                self._bundle.filename = self._bundle_name()
            for file, kind in zip(self._downloads, self.files, strict=True):
                file.filename = self.filename(kind)
            self._listing.write(fill('<pre tabindex="0"><code>{{ code }}</code></pre>', code=self.code()))


def folded(title: str, parts: Sequence[Viewable], name: str, **params: Any) -> Viewable:
    """What few need, closed until somebody opens it; ``sd-<name>`` is its class."""
    return pmui.Accordion(
        (str(escape(title)), pn.Column(*parts, sizing_mode=WIDE, margin=0, styles={"overflow-x": "auto"})),
        disable_gutters=True,
        elevation=0,
        css_classes=[f"sd-{name}"],
        **{"sizing_mode": WIDE, "margin": (8, 0), **params},
    )


def document(title: str, markdown: str, name: str) -> Viewable:
    """A longer text of ours, closed until somebody opens it; ``sd-<name>`` is its class."""
    text = Html(from_markdown(markdown), stylesheets=[DOCUMENT_STYLE], margin=(0, 8))
    return folded(title, [text], name)


def download(filename: str, kind: str, make: Callable[[], bytes], **params: Any) -> pmui.FileDownload:
    """A button that downloads what ``make()`` returns then; ``sd-download-<kind>`` is its class."""
    return pmui.FileDownload(
        callback=lambda: io.BytesIO(make()),
        filename=filename,
        label=kind.upper(),
        variant="text",
        size="small",
        margin=0,
        css_classes=[f"sd-download-{kind}"],
        **params,
    )
