"""PDF evidence of one measured profile."""

from __future__ import annotations

import numpy as np

from streamdash.observe.evidence import blurred_pdf, learn_pdfs


def test_values_are_spread_over_the_bins_by_their_errors():
    edges = np.array([-np.inf, 0.9, 1.1, np.inf])
    sharp = blurred_pdf(np.array([[0.5, 1.0, 1.0, 2.0]]), np.full(4, 1e-6), edges)
    np.testing.assert_allclose(sharp, [[0.25, 0.5, 0.25]])
    wide = blurred_pdf(np.array([[0.9]]), np.array([0.1]), edges)
    np.testing.assert_allclose(wide, [[0.5, 0.9772 - 0.5, 1 - 0.9772]], atol=1e-4)


def test_evidence_prefers_the_class_a_profile_comes_from():
    rng = np.random.default_rng(2)
    narrow, broad = rng.normal(1, 0.1, (400, 30)), rng.normal(1, 0.3, (400, 30))
    q, y = np.concatenate([narrow, broad]), np.repeat([0, 1], 400)
    rows = np.arange(800)
    judge_pdf = learn_pdfs(q, y, np.full(30, 0.05), rows[rows % 4 > 0], rows[rows % 4 == 0])
    assert judge_pdf.accuracy > 0.99
    found = judge_pdf(narrow[0])
    assert found.ln_bayes[0] == 0
    assert found.ln_bayes[1] < -5
    assert found.words == ["", "strong"]
