"""The report of an inference: answer, figures and numbers in one file that fetches nothing."""

from __future__ import annotations

import pytest

from streamdash.inference import load_estimator
from streamdash.observe.infer import answer
from streamdash.observe.observation import read_observation
from streamdash.plots.infer_html import infer_html
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from tests.unit.commands import refused


@pytest.fixture(scope="module")
def found():
    """The answer to a fresh stream of known abundance, written to a table and read again."""
    estimator = load_estimator("gd1-like")
    _, q = estimator.simulate(1, seed=5)
    design = estimator.design
    rows = zip(design.low, design.high, q[0], design.sigma, strict=True)
    file = "ell_low,ell_high,q_rho,error\n" + "".join(f"{a},{b},{v},{s}\n" for a, b, v, s in rows)
    geometry = load_geometry(estimator.stream, Cache.default())
    return answer(estimator, read_observation(file.encode(), geometry)[1])


def test_all_of_the_answer_is_in_the_file_and_nothing_is_fetched(found):
    page = infer_html(found)
    assert all(sentence.split(" (")[0] in page for sentence in found.sentences)
    assert page.count("<svg") == 1 + len(found.posterior.names)
    low, high = found.posterior.interval("log10_rate")
    assert f"{low:.2f} to {high:.2f}" in page
    assert "default-src &#39;none&#39;" in page or "default-src 'none'" in page
    assert "<script" not in page and "src=" not in page
    bits = found.estimator.card["held_out"]["log10_rate"]["bits"]
    assert f"{bits:.2f} ±" in page


def test_a_report_into_a_folder_that_is_not_there_is_refused(tmp_path):
    words = refused("infer", tmp_path / "p.csv", "--report", tmp_path / "none" / "r.html")
    assert "does not exist; make it first" in words
