"""What a class looks like everywhere, what legends show, and what files of figures say of themselves."""

from __future__ import annotations

import io
import itertools
import re

import holoviews as hv
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from app.ui.templates import Html, fill
from streamdash.config import EnsembleConfig
from streamdash.naming import ACCENT, CLASS_COLOURS, HOME_COLOURS, class_colours, class_names
from streamdash.plots.elements import line
from streamdash.plots.files import About, publish
from streamdash.plots.legend import handles, marks
from streamdash.plots.live import use


def of(mass: str, **perturbers: object) -> EnsembleConfig:
    """An ensemble of a mass range."""
    low, high = (float(x) for x in mass.split("-"))
    return EnsembleConfig.parse({"perturbers": {"mass_range": [low, high], **perturbers}})


CLASSES = [
    *(of(mass) for mass in ("1e3-1e5", "1e5-1e7", "1e5-1e9", "1e7-1e9")),
    of("1e5-1e9", half_mode_mass=1e8),
    of("1e5-1e9", rate_factor=3),
]


def test_a_colour_belongs_to_the_class_and_not_to_its_place():
    alone = dict(zip(range(len(CLASSES)), (class_colours([one])[0] for one in CLASSES), strict=True))
    for size in (2, 3, 4):
        for chosen in itertools.combinations(range(len(CLASSES)), size):
            colours = class_colours([CLASSES[i] for i in chosen])
            assert len(set(colours)) == size
            for i, colour in zip(chosen, colours, strict=True):
                assert colour == alone[i] or colour not in HOME_COLOURS.values()
    assert [alone[i] for i in range(4)] == [*CLASS_COLOURS[:1], "#009E73", "#D55E00", "#CC79A7"]
    assert ACCENT not in CLASS_COLOURS
    # Names give the colours that configurations do, in files and for people.
    assert class_colours(class_names(CLASSES[:4])) == class_colours(CLASSES[:4])


def test_classes_of_the_same_masses_are_told_apart_in_words():
    names = class_names([CLASSES[2], CLASSES[4]])
    assert names[0] != names[1] and "warm" in names[1] and "half_mode_mass" not in names[1]


def test_legends_show_the_marks_they_name():
    shown = marks((("line-dots", "a"), ("dashes-grey", "b"), ("bars-ink", "c")), ["#111111", "#222222"])
    assert [mark.kind for mark in shown] == ["line-dots", "dashes", "bars"]
    assert [len(mark.colours) for mark in shown] == [2, 1, 1]
    drawn = handles(shown)
    assert [part.get_linestyle() for part in drawn[0]] == ["-", "-"] and drawn[0][0].get_marker() == "o"
    assert drawn[1][0].get_linestyle() == "--"
    with pytest.raises(ValueError, match="no mark"):
        marks((("squiggle", "d"),))


def test_what_is_read_has_real_subscripts():
    text = "σ_ε = 0.1, N_bin = 20, y_α; n_bin and r_sum stay"
    assert "σ<sub>ε</sub> = 0.1, N<sub>bin</sub> = 20, y<sub>α</sub>; n_bin and r_sum" in _plain(text)
    markup = fill('<p title="σ_ε">σ_ε</p>')
    assert '<p title="σ_ε">σ<sub>ε</sub></p>' in Html(markup).object


def _plain(text: str) -> str:
    return Html(text).object


@pytest.fixture(scope="module")
def about() -> About:
    """Two classes at a noise."""
    return About(
        "PDF of Qρ",
        CLASSES[1:3],
        ["0123456789abcdef", "f" * 16],
        {"σ_ε": 0.25, "N_bin": 20},
        "http://x/main?a=1",
    )


def test_names_and_tables_tell_what_they_are(about):
    assert about.stem("pdf") == "streamdash_pdf_1e5-1e7_1e5-1e9_noise0.25_bins20"
    file = about.comments + "a,b\n1,2\n"
    assert list(pd.read_csv(io.StringIO(file), comment="#").columns) == ["a", "b"]
    assert (
        "# σ_ε: 0.25\n" in file
        and "ensemble 0123456789abcdef" in file
        and "# link: http://x/main?a=1\n" in file
    )
    knobs = re.search(r"# M1 knobs: (.*)\n", file)
    assert EnsembleConfig.model_validate_json(knobs[1]) == CLASSES[2]
    evil = About("a\nb,=1+1", link="x\r\n=2")
    assert all(part.startswith("# ") for part in evil.comments.splitlines())


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_files_have_legend_caption_and_metadata(about, kind):
    use("matplotlib")
    figure = hv.Overlay([line("a", np.arange(3.0), np.arange(3.0), "#0072B2", "matplotlib")])
    shown = marks((("line", "median"), ("dashes-grey", "cut $x$")), class_colours(about.configs))
    plain, full = publish(figure, kind, About("alone")), publish(figure, kind, about, shown)
    assert len(full) > len(plain)
    if kind == "png":
        image = Image.open(io.BytesIO(full))
        assert min(image.size) > 1000 and image.height > Image.open(io.BytesIO(plain)).height + 200
        assert "σ_ε = 0.25" in image.text["Description"] and image.text["Source"] == about.link
    if kind == "svg":
        assert b"http://x/main?a=1" in full and full.count(b"<?xml") == 1
