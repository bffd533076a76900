"""Figures that are made again are the figures that HoloViews drew."""

from __future__ import annotations

import holoviews as hv
import numpy as np
import pytest
from bokeh.document import Document
from bokeh.model import Model

from streamdash.plots import live
from streamdash.plots.copies import Unknown, signature
from streamdash.plots.live import LiveFigure

X = np.linspace(0.0, 1.0, 30)


def drawn(level: float = 1.0, colour: str = "red", label: str = "line", **options) -> hv.Overlay:
    live.use("bokeh")
    image = hv.Image(np.outer(X, X), bounds=(0, 0, 1, 1), label="image").opts(
        cmap="Greys", clim=(0, 1), backend="bokeh"
    )
    area = hv.Area((X, X - 0.1, X + 0.1), vdims=["low", "high"], label="band")
    curve = hv.Curve((X, level * X), "angle", "density", label=label).opts(
        color=colour, tools=["hover"], backend="bokeh"
    )
    return (image * area * curve).opts(width=300, title="<b>one</b>", backend="bokeh", **options)


def properties(figure: Model) -> list[tuple]:
    """All that every model of a figure is, whichever ids it has; references by their type."""

    def plain(value: object) -> object:
        if isinstance(value, Model):
            return type(value).__name__
        if isinstance(value, dict):
            return sorted((str(key), str(plain(item))) for key, item in value.items())
        if isinstance(value, list | tuple | set):
            return sorted(str(plain(item)) for item in value)
        return str(float(value)) if isinstance(value, int | float) else str(value)  # 1 is 1.0

    return sorted(
        (type(model).__name__, str([(k, plain(v)) for k, v in model.properties_with_values().items()]))
        for model in figure.references()
    )


def test_a_figure_made_again_is_the_one_that_was_drawn():
    first, second, third = (LiveFigure(drawn(2.0), ink=("line",)) for _ in range(3))
    assert properties(third.figure) == properties(first.figure) == properties(second.figure)
    ids = [{model.id for model in one.figure.references()} for one in (first, second, third)]
    assert not ids[0] & ids[1] and not ids[0] & ids[2] and not ids[1] & ids[2]
    document = Document()  # as one page, with a figure twice
    for one in (first, third):
        document.add_root(one.figure)
    document.validate()


def test_a_figure_with_a_span_is_drawn_however_often_it_is_asked_for():
    """What a span is declared with is not among its figure's models."""
    figures = [LiveFigure(drawn(4.0) * hv.VLine(0.5, label="usual")) for _ in range(4)]
    assert {len(one.figure.center) for one in figures} == {len(figures[0].figure.center)}
    assert all("usual" in one.sources for one in figures)


def test_it_is_not_drawn_by_holoviews_again(monkeypatch):
    for _ in range(2):
        LiveFigure(drawn(3.0))
    monkeypatch.setattr(live, "_draw", lambda *_: pytest.fail("drawn again"))
    LiveFigure(drawn(3.0))


def test_what_one_visitor_changes_no_other_sees():
    first, *_, copy = (LiveFigure(drawn(4.0), ink=("line",)) for _ in range(3))
    columns = {"line": {"density": 7 * X}}
    copy.patch(columns)
    copy.move(x=(-3.0, 3.0))
    copy.set_ink(dark=True)
    other = LiveFigure(drawn(4.0), ink=("line",))
    assert properties(other.figure) == properties(first.figure) != properties(copy.figure)
    np.testing.assert_array_equal(copy.sources["line"].data["density"], 7 * X)
    np.testing.assert_array_equal(other.sources["line"].data["density"], 4 * X)


@pytest.mark.parametrize(
    "other",
    [
        {"level": 5.1},
        {"colour": "blue"},
        {"label": "another"},
        {"xlim": (0, 2)},
        {"logy": True},
    ],
)
def test_whatever_differs_is_another_figure(other):
    assert signature(drawn(5.0)) == signature(drawn(5.0))
    assert signature(drawn(**{"level": 5.0, **other})) != signature(drawn(5.0))


def test_what_cannot_be_compared_is_drawn_each_time():
    def hooked() -> hv.Overlay:
        return drawn(6.0, hooks=[lambda plot, element: None])

    with pytest.raises(Unknown, match="function"):
        signature(hooked())
    figures = [LiveFigure(hooked()).figure for _ in range(3)]
    assert len({figure.id for figure in figures}) == 3
