"""Results for ``streamdash reproduce``: complete, plain, and told in words that follow the numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from streamdash.cli.main import app
from streamdash.config import EnsembleConfig, Perturbers
from streamdash.paper.classifier import classifier_markdown, results_of
from streamdash.simulation.ensemble import simulate
from tests.unit import made_up


@pytest.fixture(scope="module")
def results():
    """Two classes; the second one's ripples grow with the number of impacts and vanish without any."""
    rng = np.random.default_rng(0)
    x = np.linspace(0, 12, 50)
    impacts = rng.poisson(2, 150)
    q = np.ones((2, 150, 50), np.float32)
    q[1] += 0.3 * impacts[:, None] * np.sin(x + rng.uniform(0, 6, (150, 1)))
    draws = rng.standard_normal(q.shape, dtype=np.float32)
    labels = ("1e3-1e5", "1e5-1e9")
    streams = made_up.observed(q, draws, labels, n_impacts=(np.full(150, 800), impacts))
    return {"noise": 0.1, "seeds": [0, 1], "two": results_of(streams, 0.1, (0, 1), 1)}


def test_results_are_plain(results):
    assert json.loads(json.dumps(results, allow_nan=False)) == json.loads(json.dumps(results))
    for method in results["two"]["methods"].values():
        assert np.sum(method["counts"]) == 75 and len(method["accuracies"]) == 2


def test_confused_streams_are_those_with_few_impacts(results):
    confused = results["two"]["methods"]["best"]["confused"]
    right, wrong = (
        next(r for r in confused if r["label"] == "1e5-1e9" and r["kind"] == k) for k in ("right", "wrong")
    )
    assert wrong["n"] > 0 and wrong["median_impacts"] == 0 and right["median_impacts"] >= 2


def test_markdown_shows_ours_beside_the_papers(results):
    text = classifier_markdown(results)
    assert "| 1e3-1e5 | paper | 0.98 | 0.99 | 0.99 |" in text
    assert "| 1e5-1e9 | paper | 0.99 | 0.99 | 0.99 |" in text
    best = results["two"]["methods"]["best"]
    assert f"| 1e5-1e9 | best | {best['values']['precision'][1]:.3f}" in text
    assert f"accuracy {best['values']['overall_accuracy']:.4f}" in text and "(paper 0.99)" in text
    assert "had 0 impacts (median)" in text


@pytest.mark.slow
def test_reproduce_prints_table_2_and_the_matrices(geometry_cache, tmp_path, capsys):
    """On 40 fresh streams of each range: few, but from the engine to the table by the real command."""
    for label in ("1e3-1e5", "1e5-1e7", "1e7-1e9", "1e5-1e9"):
        config = EnsembleConfig(perturbers=Perturbers(mass_range=label), n_streams=40, seed=3)
        simulate(config, executor="inline", cache=geometry_cache)
    with pytest.raises(SystemExit) as end:
        app(
            ["reproduce", "--cache", str(geometry_cache.writable), "-o", str(tmp_path)],
            prog_name="streamdash",
        )
    out = capsys.readouterr().out
    assert not end.value.code
    found = json.loads((tmp_path / "classifier.json").read_text(encoding="utf-8"))
    text = (tmp_path / "table2.md").read_text(encoding="utf-8")
    assert text in out
    assert found["three"]["labels"] == ["1e3-1e5", "1e5-1e7", "1e7-1e9"]
    assert found["two"]["methods"]["best"]["values"]["overall_accuracy"] > 0.8
    for n_classes, streams in ((2, 20), (3, 30)):
        assert f"{n_classes} classes, σ_ε = 0.1, {streams} test streams (split of seed 0)" in text
