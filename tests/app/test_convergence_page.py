"""The Convergence page without a browser, on the shipped spectra and on a test's own."""

from __future__ import annotations

import gc
import io
import shutil
import weakref

import numpy as np
import pandas as pd
import pytest

from app.pages.registry import PAGES
from app.services.services import Services
from app.session.session import Session
from app.shell import Shell
from streamdash.config import EnsembleConfig, Perturbers, SpectraConfig
from streamdash.convergence.knobs import KNOBS, ConvergenceTest, Setting, knob
from streamdash.convergence.spectra import missing
from streamdash.convergence.text import measure
from streamdash.store.cache import Cache
from tests.waiting import wait_until

CONVERGENCE = "?page=convergence"


def test_all_tests_are_shipped_with_at_least_a_thousand_streams(shipped_cache):
    cache = Cache.default(shipped_cache)
    configs = {setting.config for key in KNOBS for setting in knob(key).settings}
    assert missing(tuple(configs), cache) == []
    for key in set(KNOBS) - {"streams"}:
        found, _ = measure(cache, [key])
        assert all(band.n_streams >= 990 for s in found[0].spectra for band in s.bands.values())
    entries = cache.entries(("spectra",))
    assert {entry.state for entry in entries} == {"complete"}
    assert sum(entry.size_bytes for entry in entries) < 600_000


@pytest.mark.parametrize("key", ["phase", "times"])
def test_a_test_is_figures_numbers_and_a_verdict(open_shell, key):
    page = open_shell(f"{CONVERGENCE}&knob={key}").page
    chosen = knob(key)
    assert page.task.start.visible is False
    for i, setting in enumerate(chosen.settings):
        assert setting.label in page.table.object
        shift = page.measured.verdict.of(i, "density", "small", observed=True)
        assert shift is None or f"{shift.mean:+z.2f} ± {shift.error:.2f}" in page.table.object
    assert page.card._sentence.text.startswith(("Converged from", "Agrees", "Within", "Differs", "No other"))
    assert "core minutes" in page.card._sentence.text
    rows = pd.read_csv(io.BytesIO(page.card.files["csv"]()), comment="#")
    assert set(rows.setting) == {setting.label for setting in chosen.settings}
    assert set(rows.spectrum) == {"density", "track", "cross"}
    band = page.measured.spectra[0].bands["cross"]
    first = rows[(rows.setting == chosen.settings[0].label) & (rows.spectrum == "cross")]
    np.testing.assert_allclose(first.median_sqrt_power_rad, band.median, rtol=1e-4)


def test_all_verdicts_stand_together_with_what_they_cost(open_shell):
    page = open_shell(CONVERGENCE).page
    for key in KNOBS:
        assert knob(key).title in page.all.object
    assert "not simulated" not in page.all.object
    for one in page.found:
        worst = one.verdict.worst
        assert f"{worst.mean:+z.2f} ± {worst.error:.2f}" in page.all.object
    assert "core minutes" in page.all_card._sentence.text
    shifts = pd.read_csv(io.BytesIO(page.all_card.files["csv"]()), comment="#")
    assert set(shifts.knob) == set(KNOBS)


def test_the_code_shown_draws_and_judges(open_shell, shipped_cache, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    monkeypatch.chdir(tmp_path)
    page = open_shell(f"{CONVERGENCE}&knob=length").page
    exec(compile(page.code(), "<shown>", "exec"), {})
    assert (tmp_path / "convergence.png").stat().st_size > 10_000
    assert capsys.readouterr().out.strip() in page.card._sentence.text


def test_a_test_that_is_missing_says_so_and_is_simulated_on_request(shipped_cache, tmp_path, monkeypatch):
    """With a knob of the test's own, so that it takes seconds."""
    ensembles = [EnsembleConfig(perturbers=Perturbers(X=x), n_streams=4, n_theta=30) for x in (1.0, 2.0)]
    settings = tuple(Setting(f"X = {e.perturbers.X:g}", SpectraConfig(ensemble=e), 1) for e in ensembles)
    tiny = ConvergenceTest("x", "Tiny", "Does it matter?", "No.", settings, ordered=True)
    monkeypatch.setitem(KNOBS, "x", lambda n_streams, seed: tiny)
    for kind in ("ensembles", "geometries"):
        for path in (shipped_cache / kind).glob("*-*"):
            if kind == "ensembles" or path.name.startswith("leading-9Gyr-64times"):
                (tmp_path / kind).mkdir(exist_ok=True)
                shutil.copytree(path, tmp_path / kind / path.name)
    services = Services(Cache.default(tmp_path))
    session = Session(tuple(page.key for page in PAGES), services.catalog())
    session.load(f"{CONVERGENCE}&knob=x")
    page = Shell(session, services, PAGES).page
    assert "2 of the 2 settings are not simulated yet" in page.task.text.text
    assert page.task.start.visible
    page.start()

    def look() -> bool:
        page.watch.look()
        return page.watch.following is None

    wait_until(look, "still computing", 0.1)
    assert page.measured is not None
    assert page.task.start.visible is False
    assert "X = 1" in page.table.object
    assert "Tiny" in page.all.object


def test_a_page_that_was_left_is_freed(open_shell):
    shell = open_shell(CONVERGENCE)
    page = weakref.ref(shell.page)
    shell.session.page = "profiles"
    gc.collect()
    assert page() is None
