"""The Profiles page without a browser: controls change what the figures hold."""

from __future__ import annotations

import io
import shutil

import numpy as np
import pandas as pd
import pytest

from app.pages.profiles.page import ProfilesPage
from app.services.services import Services
from app.session.session import Session
from app.shell import Shell
from streamdash.plots import profiles
from streamdash.store.cache import Cache
from streamdash.survey import bands

TWO = "?page=profiles&mass=1e3-1e5,1e5-1e9"


def shown(shell: Shell, index: int, label: str) -> dict[str, np.ndarray]:
    """Columns that the browser has for one element of one panel."""
    return {name: np.array(data) for name, data in shell.page.live[index].sources[label].data.items()}


def words(shell: Shell) -> str:
    """Text of what takes the page's place."""
    return " ".join(pane.object for pane in shell.slot[0].objects)


def test_columns_of_the_sources_are_the_ones_that_are_patched(open_shell):
    shell = open_shell(TWO)
    for x in ("theta", "ell", "phi1"):
        shell.session.x = x
        for panel in shell.page.panels:
            for label, columns in profiles.columns(panel).items():
                source = shell.page.live[panel.index].sources[label]
                pinned = {"x", "y", "dw", "dh", "image"} if label == profiles.STREAMS else set(columns)
                assert set(source.data) == pinned
                for name, values in columns.items():
                    np.testing.assert_array_equal(np.array(source.data[name]), np.array(values))


def test_noise_widens_the_band_by_what_it_should(open_shell):
    shell = open_shell(TWO + "&noise=0")
    quiet = shown(shell, 0, profiles.MEDIAN)
    shell.session.noise = 0.5
    noisy = shown(shell, 0, profiles.MEDIAN)
    spread = (quiet["high"] - quiet["low"]) / 2
    expected = np.sqrt(spread**2 + 0.5**2)  # variances add; 10³–10⁵ is close to Gaussian
    assert np.mean((noisy["high"] - noisy["low"]) / 2) == pytest.approx(np.mean(expected), rel=0.03)


def test_the_same_noise_shows_the_same_figure_again(open_shell):
    shell = open_shell(TWO + "&noise=0.2")
    before = shown(shell, 1, profiles.STREAMS)["image"]
    shell.session.noise = 0.4
    between = shown(shell, 1, profiles.STREAMS)["image"]
    shell.session.noise = 0.2
    assert not np.array_equal(before, between)
    np.testing.assert_array_equal(shown(shell, 1, profiles.STREAMS)["image"], before)


def test_bands_are_the_quantiles_of_the_noisy_profiles(open_shell, services):
    shell = open_shell(TWO + "&noise=0.3")
    for index, choice in enumerate(shell.session.ensembles):
        (values,) = services.observed([choice]).noisy(0.3)
        expected = np.quantile(values, [0.16, 0.5, 0.84], axis=0)
        found = shown(shell, index, profiles.MEDIAN)
        for name, quantile in zip(("low", "q_rho", "high"), expected, strict=True):
            np.testing.assert_allclose(found[name], quantile, atol=0.006)


def test_highlighted_lines_are_streams_of_the_ensemble_with_their_noise(open_shell, services):
    shell = open_shell(TWO + "&noise=0.1&highlight=4&seed=7")
    choice = shell.session.ensembles[1]
    (values,) = services.observed([choice]).noisy(0.1)
    lines = shown(shell, 1, profiles.HIGHLIGHTS)
    numbers = np.unique(lines["stream"])
    assert len(numbers) == 4
    for number in numbers:
        line = lines["q_rho"][lines["stream"] == number]
        assert np.isnan(line[-1])
        np.testing.assert_allclose(line[:-1], values[number], rtol=1e-5, atol=1e-5)


def test_draw_others_and_the_number_of_highlights(open_shell):
    shell = open_shell(TWO)
    before = np.unique(shown(shell, 0, profiles.HIGHLIGHTS)["stream"])
    shell.page.draw_others()
    after = np.unique(shown(shell, 0, profiles.HIGHLIGHTS)["stream"])
    assert not np.array_equal(before, after)
    shell.session.highlight = 0
    assert len(shown(shell, 0, profiles.HIGHLIGHTS)["stream"]) == 0


def test_image_counts_every_stream_where_nothing_leaves_the_frame(open_shell, services):
    shell = open_shell(TWO + "&noise=0")
    choice = shell.session.ensembles[0]
    values = services.observed([choice]).q[0]
    rows, _ = np.histogram(values[:, 100], bins=bands.IMAGE_ROWS, range=bands.RANGES["q_rho"])
    image = shown(shell, 0, profiles.STREAMS)["image"][0]
    assert image.dtype == np.uint8
    # Rounding at a cell's edge may move a stream to the next cell; an empty cell stays empty.
    assert ((image[:, 100] > 0) == (rows > 0)).mean() > 0.97


@pytest.mark.parametrize("quantity", ["q_rho", "rho", "omega"])
@pytest.mark.parametrize("coordinate", ["ell", "theta", "phi1"])
def test_every_quantity_along_every_coordinate(open_shell, quantity, coordinate):
    shell = open_shell(f"{TWO}&y={quantity}&x={coordinate}")
    columns = shown(shell, 1, profiles.MEDIAN)
    assert {coordinate, quantity, "low", "high", "smooth"} == set(columns)
    assert np.isfinite(columns[quantity]).all()
    low, high = bands.RANGES[quantity]
    assert (columns["low"] >= low).all()
    assert (columns["high"] <= high).all()
    figure = shell.page.live[1].figure
    assert (figure.y_range.start, figure.y_range.end) == (low, high)
    assert figure.x_range.start < columns[coordinate].min() < columns[coordinate].max() < figure.x_range.end


def test_noise_leaves_the_mean_frequency_alone(open_shell):
    shell = open_shell(TWO + "&y=omega&noise=0")
    before = shown(shell, 1, profiles.MEDIAN)["high"]
    shell.session.noise = 1.0
    np.testing.assert_array_equal(shown(shell, 1, profiles.MEDIAN)["high"], before)
    assert "does not act" in shell.page.card._sentence.text


def test_the_sentence_says_what_is_shown_now(open_shell):
    shell = open_shell(TWO + "&noise=0.25")
    text = shell.page.card._sentence.text
    assert "σ_ε = 0.25" in text
    assert "10³–10⁵ M☉" in text
    shell.session.noise = 0.5
    assert "σ_ε = 0.5" in shell.page.card._sentence.text


def test_downloads_hold_the_numbers_that_are_shown(open_shell):
    shell = open_shell(TWO + "&noise=0.2&highlight=2")
    table = pd.read_csv(io.BytesIO(shell.page.card.files["csv"]()), comment="#")
    first = table[table.model == "M0"]
    found = shown(shell, 0, profiles.MEDIAN)
    np.testing.assert_allclose(first.ell_deg, found["ell"], rtol=1e-5)
    np.testing.assert_allclose(first["median"], found["q_rho"], rtol=1e-5)
    assert table.highlight_2.notna().all()
    assert shell.page.card.files["png"]().startswith(b"\x89PNG")
    assert b"<svg" in shell.page.card.files["svg"]()[:2000]


def test_the_code_shown_runs_and_makes_the_figure(open_shell, shipped_cache, tmp_path, monkeypatch):
    shell = open_shell(TWO + "&noise=0.2&y=rho&x=theta&highlight=2&seed=5")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    scope: dict = {}
    exec(shell.page.code(), scope)
    assert (tmp_path / "profiles.png").read_bytes().startswith(b"\x89PNG")
    read = bands.read_profiles(Cache.default(), scope["ensembles"], "rho")
    panels = [bands.compute(binned, i, "theta", 0.2, 2, 5) for i, binned in enumerate(read)]
    for panel, own in zip(panels, shell.page.panels, strict=True):
        np.testing.assert_array_equal(panel.image, own.image)


def test_a_damaged_ensemble_is_named_and_the_others_are_shown(shipped_cache, tmp_path):
    folder = tmp_path / "cache"
    shutil.copytree(shipped_cache, folder)
    services = Services(Cache.default(folder))
    session = Session(("profiles",), services.catalog())
    session.load("?mass=1e3-1e5,1e5-1e7,1e7-1e9")
    # Damaged after the session has seen it: the catalog would leave it out.
    broken = session.ensembles[1]
    largest = max((folder / "ensembles").glob(f"*{broken.key}/**/*"), key=lambda p: p.stat().st_size)
    content = bytearray(largest.read_bytes())
    content[len(content) // 2] ^= 0xFF
    largest.write_bytes(content)
    shell = Shell(session, services, (ProfilesPage,))
    assert list(shell.page.live) == [0, 2]
    assert broken.key in shell.page.failures[1]
    shell.session.noise = 0.3
    assert [panel.index for panel in shell.page.panels] == [0, 2]


def test_an_empty_cache_says_what_to_do(cache_dir):
    services = Services(Cache.default())
    session = Session(("profiles",), services.catalog())
    session.load("?noise=0.4")
    shell = Shell(session, services, (ProfilesPage,))
    assert shell.page is None
    assert "streamdash simulate" in words(shell)


def test_a_page_that_fails_shows_a_sentence_and_never_a_traceback(open_shell, monkeypatch, caplog):
    shell = open_shell(TWO)
    monkeypatch.setattr(shell.page, "_compute", lambda: 1 / 0)
    shell.session.noise = 0.7
    assert "failed unexpectedly" in words(shell)
    assert "ZeroDivisionError" in caplog.text


def test_widgets_and_session_follow_one_another_until_the_page_closes(open_shell):
    shell = open_shell(TWO)
    session = shell.session
    slider = next(w for w in shell.view.select(lambda v: "sd-noise" in getattr(v, "css_classes", [])))
    slider.value = 0.42
    assert session.noise == 0.42
    session.noise = 0.17
    assert slider.value == 0.17
    slider.value = 0.30000000000000004  # what a browser makes of thirty steps of 0.01
    assert session.noise == 0.3
    assert slider.value == 0.30000000000000004  # not echoed: the thumb may be further on by now
    session.noise = 0.17
    slider.value = 7.0  # as a hand-made message could
    assert session.noise == slider.value == 0.17
    shell.close()
    session.noise = 0.9
    assert slider.value == 0.17


def test_changing_the_mass_ranges_builds_the_panels_anew(open_shell):
    shell = open_shell(TWO)
    stream = shell.session.catalog.streams[0]
    shell.session.mass = [choice.key for choice in stream.ensembles]
    assert len(shell.page.live) == len(stream.ensembles)
    assert shell.address.search == shell.session.search
    picker = next(w for w in shell.view.select(lambda v: "sd-mass" in getattr(v, "css_classes", [])))
    picker.value = picker.value[:1]
    assert len(shell.session.mass) == len(picker.value) == len(stream.ensembles)
    (refusal,) = shell.view.select(lambda v: "sd-mass-refusal" in getattr(v, "css_classes", []))
    assert "At least 2" in refusal.text


def test_going_back_restores_the_view(open_shell):
    shell = open_shell(TWO)
    shell.session.noise = 0.6
    shell.address.search = "?noise=0.3&y=rho"
    assert (shell.session.noise, shell.session.y) == (0.3, "rho")


def test_dark_mode_recolours_the_ink(open_shell):
    shell = open_shell(TWO)
    glyphs = [r.glyph for r in shell.page.live[0].figure.renderers]
    before = [getattr(glyph, "line_color", None) for glyph in glyphs]
    shell.view.dark_theme = True
    assert shell.session.theme == "dark"
    after = [getattr(glyph, "line_color", None) for glyph in glyphs]
    assert sum(a != b for a, b in zip(before, after, strict=True)) == 2


def test_pages_are_dark_where_the_system_is_unless_chosen_otherwise(open_shell):
    shell = open_shell(TWO)
    shell.address.dark = True  # as the browser says on the first visit
    assert shell.view.dark_theme and "theme" not in shell.session.search
    inked = [
        r.glyph.line_color for r in shell.page.live[0].figure.renderers if hasattr(r.glyph, "line_color")
    ]
    assert "#e6e8eb" in inked
    shell.view.dark_theme = False
    assert not shell.session.dark and "theme=light" in shell.session.search
    shell.view.dark_theme = True
    assert shell.session.dark and "theme" not in shell.session.search


def test_a_tab_that_is_loaded_anew_is_the_same_visitor(open_shell):
    first, second = open_shell(TWO), open_shell(TWO)
    assert first.address.visitor == first.session.visitor != second.session.visitor
    second.address.visitor = first.session.visitor  # as the browser kept it
    assert second.session.visitor == first.session.visitor
    second.address.visitor = "<script>"
    assert second.session.visitor == first.session.visitor


@pytest.mark.parametrize("scale", ["own", "log", "residual"])
def test_vertical_scales(open_shell, scale):
    shell = open_shell(f"{TWO}&noise=0.1&scale={scale}")
    plain = bands.compute(shell.page._binned(shell.session.ensembles[0], "q_rho"), 0, "ell", 0.1, 3, 0)
    panel = shell.page.panels[0]
    low, high = panel.extent[1::2]
    if scale == "log":
        np.testing.assert_allclose(panel.median, np.log10(plain.median), atol=2e-3)
    else:
        assert high - low < plain.extent[3] - plain.extent[1]  # 10³–10⁵ needs a tenth of the shared one
        offset = plain.median if scale == "residual" else 0.0
        np.testing.assert_allclose(panel.high, plain.high - offset, atol=5e-3)
        np.testing.assert_allclose(panel.highlighted, plain.highlighted - offset, atol=1e-5)
    values = shell.page._binned(shell.session.ensembles[0], "q_rho")
    noisy = values.values + 0.1 * values.draws
    there = np.log10(np.maximum(noisy, 0.01)) if scale == "log" else noisy
    if scale == "residual":
        there = noisy - plain.median[:, None]
    off = np.mean((there < low) | (there >= high))
    assert panel.off == pytest.approx(off, abs=1e-4)
    assert panel.scale == scale and f'scale="{scale}"' in shell.page.code()
    shell.session.noise = 0.5  # a scale of its own follows
    for shown_panel, live in zip(shell.page.panels, shell.page.live.values(), strict=True):
        ends = live.figure.y_range.start, live.figure.y_range.end
        assert ends == pytest.approx(shown_panel.extent[1::2])


def test_a_highlighted_stream_says_how_often_it_was_hit(open_shell):
    shell = open_shell(f"{TWO}&highlight=2&seed=4")
    panel = shell.page.panels[1]
    hits = shell.page.services.observed([shell.session.ensembles[1]]).n_impacts[0]
    np.testing.assert_array_equal(panel.impacts, hits[panel.streams])
    there = shown(shell, 1, profiles.HIGHLIGHTS)
    assert set(there["impacts"]) == set(panel.impacts) and panel.impacts.min() > 0
