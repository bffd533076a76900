"""The Spectrum page without a browser."""

from __future__ import annotations

import gc
import io
import weakref

import numpy as np
import pandas as pd
import pytest

from app.work.pieces import noisy_profiles
from streamdash.plots import spectrum
from streamdash.statistics.spectrum import band_of, power_spectrum

SPECTRUM = "?page=spectrum&mass=1e3-1e5,1e5-1e9"


def data(live, label: str) -> dict[str, np.ndarray]:
    return {name: np.array(values) for name, values in live.sources[label].data.items()}


def test_the_figure_follows_the_noise(open_shell, services):
    shell = open_shell(SPECTRUM)
    page = shell.page
    for noise in (0.1, 0.4):
        shell.session.noise = noise
        profiles = noisy_profiles(services, shell.session.ensembles, noise)
        for m, q in enumerate(profiles):
            expected = band_of(*power_spectrum(q, page._design().step))
            np.testing.assert_allclose(data(page.live["density"], f"median {m}")["y"], expected.median, 1e-3)
        np.testing.assert_allclose(data(page.live["density"], "noise")["y"], page._level().median * noise)
    assert "σ_ε = 0.4" in page.card._sentence.text
    shell.session.noise = 0
    assert (data(page.live["density"], "noise")["y"] < 1e-6).all()
    shell.session.noise = 0.4
    assert "tested at σ<sub>ε</sub> = 0.4" in page.statements.object


def test_every_patched_column_arrives_and_statements_are_said_true_or_not(open_shell):
    shell = open_shell("?page=spectrum&mass=1e3-1e5,1e5-1e7,1e7-1e9")
    shell.session.noise = 0.33
    page = shell.page
    figures = [(live, spectrum.columns(page.data, kind)) for kind, live in page.live.items()]
    figures += [
        (live, spectrum.bispectrum_columns(page.bispectra, part)) for part, live in page.live_b.items()
    ]
    assert len(figures) == 5
    words = page.statements.object
    assert words.count('<tr><th scope="row">') == 6
    for statement in page.data.statements:
        assert ("✓ true" if statement.clean_true else "✗ not true") in words
    assert "✗ not true" in words  # 10⁵–10⁷ and 10⁷–10⁹ overlap
    for live, columns in figures:
        for label, new in columns.items():
            assert set(live.sources[label].data) == set(new)
            for name, values in new.items():
                np.testing.assert_array_equal(np.array(live.sources[label].data[name]), values)


def test_tables_and_code_give_what_is_shown(open_shell, shipped_cache, tmp_path, monkeypatch, capsys):
    page = open_shell(SPECTRUM).page
    frame = page.card.files["csv"]()
    rows = pd.read_csv(io.BytesIO(frame), comment="#")
    shown = rows[(rows.model == "M1") & (rows.spectrum == "density")]
    np.testing.assert_allclose(
        shown.median_sqrt_power_deg, data(page.live["density"], "median 1")["y"], rtol=1e-4
    )
    assert set(rows.spectrum) == {"density", "density without noise", "shot noise"}
    assert b"abs_b" in page.bispectrum_card.files["csv"]()
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    monkeypatch.chdir(tmp_path)
    for code in (page.code(), page.code_bispectrum()):
        exec(compile(code, "<shown>", "exec"), {})
    assert (tmp_path / "spectrum-density.png").stat().st_size > 10_000
    assert float(capsys.readouterr().out.split()[0]) == pytest.approx(page.bispectra[0].scale_1, rel=1e-6)


def test_a_page_that_was_left_is_freed(open_shell):
    shell = open_shell(SPECTRUM)
    page = weakref.ref(shell.page)
    shell.session.page = "profiles"
    gc.collect()
    assert page() is None
