"""The PDF and Evidence pages without a browser: controls change what figures, table and words hold."""

from __future__ import annotations

import gc
import io
import weakref

import numpy as np
import pytest

from app.pages.evidence.page import EvidencePage
from app.pages.pdf.page import PdfPage
from app.services.services import Services
from app.work.pieces import noisy_profiles
from streamdash.plots import evidence, pdf
from streamdash.statistics.cumulative import cumulative_tables
from streamdash.statistics.evidence import PAPER_TABLE_1, compare
from streamdash.statistics.pdf import central_range, measure_pdfs
from streamdash.store.cache import Cache

N_STREAMS = 100  # of each class in the cache below
PDF = "?page=pdf&mass=1e3-1e5,1e5-1e9"
EVIDENCE = "?page=evidence&mass=1e3-1e5,1e5-1e9"
THREE = "1e3-1e5,1e5-1e7,1e7-1e9"


@pytest.fixture(scope="module")
def services(small_cache_of_four) -> Services:
    """Services of a server on few streams."""
    return Services(Cache.default(small_cache_of_four))


def data(live, label: str) -> dict[str, np.ndarray]:
    """Columns that the browser has for one element."""
    return {name: np.array(values) for name, values in live.sources[label].data.items()}


def test_pdf_page_shows_the_quantiles_of_the_noisy_streams(open_shell, services):
    shell = open_shell(f"{PDF}&noise=0.2&n_bin=30")
    profiles = noisy_profiles(services, shell.session.ensembles, 0.2)
    pdfs = measure_pdfs(profiles, 30, central_range(profiles))
    for model in range(2):
        median = np.median(pdfs.y[model], axis=0)
        np.testing.assert_allclose(data(shell.page.live, f"median {model}")["y"], np.repeat(median, 2))


def test_every_patched_column_exists_and_arrives(open_shell):
    shell = open_shell(f"?page=pdf&mass={THREE}")
    shell.session.n_bin = 47
    page = shell.page
    for live, columns in (
        (page.live, pdf.columns(page.data, page.selected)),
        (page.live_y, pdf.y_columns(page.data, page.selected)),
    ):
        for label, new in columns.items():
            assert set(live.sources[label].data) == set(new)
            for name, values in new.items():
                np.testing.assert_array_equal(np.array(live.sources[label].data[name]), values)


@pytest.mark.slow
def test_every_patched_column_of_ln_b_exists_and_arrives(open_shell):
    shell = open_shell(f"?page=evidence&mass={THREE}&fiducial=1")
    shell.session.noise = 0.3
    page = shell.page
    for label, new in evidence.columns(page.data, 1).items():
        assert set(page.live.sources[label].data) == set(new)
        for name, values in new.items():
            np.testing.assert_array_equal(np.array(page.live.sources[label].data[name]), values)


def test_choosing_a_bin_shows_its_distribution_for_every_class(open_shell):
    shell = open_shell(PDF)
    before = data(shell.page.live_y, "y 0")
    shell.session.alpha = 4
    page = shell.page
    assert page.slider.value == 4
    np.testing.assert_allclose(data(page.live, pdf.SELECTED)["x0"], page.data.edges[3])
    for model in range(2):
        heights = np.histogram(page.data.sorted_y[model][3], pdf.y_heights(page.data, 3)[0], density=True)[0]
        shown = data(page.live_y, f"y {model}")["y"][: 2 * len(heights)]
        np.testing.assert_allclose(shown, np.repeat(heights, 2), rtol=1e-6)
    assert not np.array_equal(before["y"], data(page.live_y, "y 0")["y"])
    assert "α = 4" in page.card_y._sentence.text


def test_the_slider_of_the_bin_and_a_tap_choose_the_same(open_shell):
    shell = open_shell(PDF)
    page = shell.page
    page.slider.value = 6
    assert shell.session.alpha == 6

    class At:
        x = float(page.data.centers[8])

    page._tapped(At)
    assert (shell.session.alpha, page.slider.value) == (9, 9)
    At.x = 99.0  # beside the histogram
    page._tapped(At)
    assert shell.session.alpha == 9


def test_another_number_of_bins_keeps_the_place(open_shell):
    shell = open_shell(f"{PDF}&n_bin=20&alpha=14")
    place = shell.page.data.centers[13]
    shell.session.n_bin = 80
    low, high = shell.page.data.edges[shell.session.alpha - 1 : shell.session.alpha + 1]
    assert low <= place <= high
    assert shell.page.slider.end == 80


def test_a_link_with_a_bin_beyond_the_last_shows_the_last(open_shell):
    shell = open_shell(f"{PDF}&n_bin=10&alpha=300")
    assert shell.page.selected == 9


def test_evidence_page_shows_ln_b_of_the_chosen_fiducial(open_shell, services):
    shell = open_shell(f"{EVIDENCE}&n_bin=25")
    expected = compare(noisy_profiles(services, shell.session.ensembles, 0.1), 0.1, 25).evidence
    np.testing.assert_allclose(data(shell.page.live, "ln_b 1")["y"], expected.ln_bayes(0, 0, 1)[0])
    shell.session.fiducial = 1
    np.testing.assert_allclose(data(shell.page.live, "ln_b 0")["y"], expected.ln_bayes(1, 1, 0)[0])
    assert "10⁵–10⁹" in shell.page.card._sentence.text.split(":")[0]


def test_excluded_bins_are_grey_and_not_in_the_sum(open_shell):
    shell = open_shell(f"{EVIDENCE}&exclude=noise")
    spans = data(shell.page.live, evidence.EXCLUDED)
    grey = np.zeros(20, dtype=bool)
    for left, right in zip(spans["x0"], spans["x1"], strict=True):
        grey |= (shell.page.data.centers > left) & (shell.page.data.centers < right)
    np.testing.assert_array_equal(grey, ~shell.page.data.evidence.kept(0, 0, 1))
    assert 0 < grey.sum() < 20


def test_table_has_the_papers_numbers_beside_ours(open_shell, services):
    shell = open_shell(EVIDENCE)
    html = shell.page.table_pane.object
    for row in PAPER_TABLE_1.values():
        for value in row:
            assert f"<td>{value:.1f}<small>" in html

    def redraw(number):
        return noisy_profiles(services, shell.session.ensembles, 0.1, number)

    tables = cumulative_tables(redraw(0), 0.1, redraw=redraw)
    for table, shown in zip(tables, shell.page.tables, strict=True):
        for pair, other in zip(table["pairs"], shown["pairs"], strict=True):
            assert f"<td>{pair['sum']:.1f} ± {pair['error']:.1f}<small>" in html
            assert f"<td>{100 * other['right']:.1f} %<small>" in html
            # A stream that is as likely under both falls to either side by the last digits of a sum.
            assert abs(pair["right"] - other["right"]) <= 1 / N_STREAMS + 1e-9
    for word in ("strong evidence", "moderate evidence", "weak evidence"):
        assert word in html


def test_paper_is_only_beside_the_papers_classes(open_shell):
    shell = open_shell(f"?page=evidence&mass={THREE}")
    assert not shell.page.is_paper
    assert "Paper" not in shell.page.table_pane.object
    assert shell.page.table_pane.object.count("<tbody>") == 2  # the chosen fiducial against two others
    shell.session.fiducial = 2
    assert "Truth <span" in shell.page.table_pane.object
    assert shell.page.table_pane.object.count("M2 10⁷–10⁹") == 2


def test_all_sessions_share_one_computation(open_shell):
    first, second = open_shell(f"{EVIDENCE}&noise=0.17"), open_shell(f"{PDF}&noise=0.17")
    assert first.page.data is second.page.data
    assert open_shell(f"{EVIDENCE}&noise=0.18").page.data is not first.page.data


@pytest.mark.parametrize("query", ["noise=0", "noise=1", "n_bin=2", "n_bin=500", "noise=0&exclude=measured"])
def test_extreme_settings_are_shown_not_refused(open_shell, query):
    for page, kind in ((PDF, PdfPage), (EVIDENCE, EvidencePage)):
        assert isinstance(open_shell(f"{page}&{query}").page, kind)


def test_code_of_every_card_runs_and_draws_what_is_shown(
    open_shell, services, small_cache_of_four, tmp_path, monkeypatch
):
    monkeypatch.setenv("STREAMDASH_CACHE", str(small_cache_of_four))
    monkeypatch.chdir(tmp_path)
    for query in (f"{PDF}&noise=0.2&n_bin=12&alpha=3", f"{EVIDENCE}&noise=0.2&n_bin=12&exclude=measured"):
        page = open_shell(query).page
        for code in (page.code, getattr(page, "code_y", None)):
            if code is not None:
                exec(compile(code(), "<shown>", "exec"), {})
    assert {path.name for path in tmp_path.iterdir()} == {"pdf.png", "pdf-bin.png", "evidence.png"}


def test_code_of_the_table_prints_the_tables_numbers(open_shell, small_cache_of_four, monkeypatch, capsys):
    monkeypatch.setenv("STREAMDASH_CACHE", str(small_cache_of_four))
    page = open_shell(EVIDENCE).page
    exec(compile(page.code_table(), "<shown>", "exec"), {})
    first = capsys.readouterr().out.splitlines()[0].split()
    assert float(first[3]) == pytest.approx(page.tables[0]["pairs"][0]["sum"])
    exec(compile(page.code_growth(), "<shown>", "exec"), {})
    assert "Growth(n_streams=" in capsys.readouterr().out


def test_tables_for_download_have_the_numbers_that_are_shown(open_shell):
    shell = open_shell(f"{EVIDENCE}&n_bin=15")
    page = shell.page
    chosen = [choice.config for choice in shell.session.ensembles]
    frame = evidence.table(page.data, 0, chosen)
    np.testing.assert_allclose(frame["ln_bayes"], data(page.live, "ln_b 1")["y"])
    assert frame["kept"].sum() == page.data.evidence.kept(0, 0, 1).sum()
    bands = pdf.table(page.data, chosen)
    assert len(bands) == 2 * 15
    assert (
        io.StringIO(bands.to_csv(index=False)).readline().startswith("model,mass_range_msun,bin,q_rho_from")
    )


def test_growth_has_converging_numbers_of_streams(open_shell):
    page = open_shell(EVIDENCE).page
    (curve,) = page.curves.values()
    assert curve.n_streams[-1] == N_STREAMS
    assert f"{N_STREAMS} streams" in page.growth_card._sentence.text


@pytest.mark.parametrize("query", [PDF, EVIDENCE])
def test_a_page_that_was_left_is_freed(open_shell, query):
    shell = open_shell(query)
    page = weakref.ref(shell.page)
    shell.session.page = "profiles"
    gc.collect()
    assert page() is None


def test_evidence_against_noise_agrees_with_the_figure_and_marks_the_noise_chosen(open_shell):
    page = open_shell(EVIDENCE).page
    curve = page.noise_curves[1]
    at = curve.noise.tolist().index(0.1)
    assert curve.value[at] == pytest.approx(page.data.evidence.cumulative(0, 0, 1).value)
    assert curve.value[1] > curve.value[-1] and (curve.low <= curve.high).all()
    assert "M1" in page.noise_card.words and page.noise_card.ready
    page.session.noise = 0.5
    np.testing.assert_array_equal(data(page.live_noise, evidence.NOW)["x"], 0.5)
    assert page.noise_curves[1] is curve  # the same at every noise: not computed anew


def test_pdf_lies_over_ln_b_on_one_axis_and_follows(open_shell):
    page = open_shell(EVIDENCE).page
    assert page.live_pdf.figure.x_range is page.live.figure.x_range
    before = data(page.live_pdf, "median 0")["y"]
    page.session.n_bin = 31
    assert len(data(page.live_pdf, "median 0")["y"]) == 62 != len(before)


def test_of_more_than_two_classes_one_band_is_drawn(open_shell):
    shell = open_shell(f"?page=pdf&mass={THREE}")
    seen = [drawn_by(shell.page.live, f"band {m}") for m in range(3)]
    assert [renderer.visible for renderer in seen] == [True, False, False]
    shell.session.focus = 3
    assert [renderer.visible for renderer in seen] == [False, False, True]
    shell.session.focus = 0
    assert all(renderer.visible for renderer in seen)
    two = open_shell(PDF).page.live
    assert drawn_by(two, "band 0").visible and drawn_by(two, "band 1").visible


def drawn_by(live, label: str):
    """What draws an element in the browser."""
    (found,) = (r for r in live.figure.renderers if getattr(r, "data_source", None) is live.sources[label])
    return found
