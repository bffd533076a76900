"""PDF and evidence of 3 classes × 2,000 streams × 347 bins, N_bin = 100, must follow a slider: 150 ms."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from streamdash.config import StreamModel
from streamdash.statistics.evidence import measure_evidence
from streamdash.statistics.evidence_growth import bootstrap
from streamdash.statistics.joint import joint_evidence
from streamdash.statistics.pdf import measure_pdfs
from streamdash.streams import window_of
from streamdash.survey import sky

TARGET_S = 0.150
NOISE = 0.1
PAIRS = [(i, j) for i in range(3) for j in range(3) if i != j]


@pytest.fixture(scope="module")
def streams() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Profiles of three classes with the scatter of real ones, and their noise draws."""
    rng = np.random.default_rng(0)
    profiles = []
    for scatter in (0.05, 0.3, 0.9):
        walk = np.cumsum(rng.standard_normal((2000, 347)), axis=1) / np.sqrt(347)
        profiles.append(np.exp(scatter * walk).astype(np.float32))
    return profiles, [rng.standard_normal(q.shape).astype(np.float32) for q in profiles]


def everything(profiles, draws, noise):
    """What one move of the noise slider asks for."""
    noisy = [q + np.float32(noise) * d for q, d in zip(profiles, draws, strict=True)]
    pdfs = measure_pdfs(noisy, 100)
    bands = [pdfs.band(m) for m in range(pdfs.n_models)]
    evidence = measure_evidence(pdfs, noise)
    lines = [evidence.ln_bayes(i, i, j) for i, j in PAIRS]
    return bands, lines, [evidence.cumulative(i, i, j) for i, j in PAIRS]


@pytest.mark.benchmark(group="evidence")
def test_pdf_and_evidence(benchmark, streams):
    _, _, totals = benchmark.pedantic(everything, args=(*streams, NOISE), warmup_rounds=2, rounds=15)
    assert all(total.n_kept for total in totals)
    if benchmark.stats is not None:
        assert benchmark.stats.stats.median <= TARGET_S


@pytest.mark.benchmark(group="evidence")
def test_joint_evidence_of_all_pairs(benchmark, streams):
    pdfs, evidence = measured(*streams)

    def all_pairs():
        return [joint_evidence(pdfs.y[i], pdfs.y[j], evidence.kept(i, i, j)) for i, j in PAIRS if i < j]

    assert all(
        joint.n_components
        for pair in benchmark.pedantic(all_pairs, warmup_rounds=1, rounds=5)
        for joint in pair
    )


@pytest.mark.benchmark(group="evidence")
def test_bootstrap_of_all_pairs(benchmark, streams):
    errors = benchmark.pedantic(bootstrap, args=measured(*streams), warmup_rounds=1, rounds=3)
    assert np.isfinite(errors).all()


@pytest.mark.benchmark(group="survey")
def test_profiles_of_an_ensemble(benchmark, geometry):
    """Qρ of 2,000 streams in the bins of the default window."""
    theta = np.linspace(*window_of(StreamModel()).theta, 400)
    ensemble = xr.Dataset(
        {
            "density": (("stream", "theta"), np.ones((2000, 400), dtype="float32")),
            "smooth": ("theta", geometry.smooth_density(theta)),
        },
        coords={"theta": theta},
    )
    edges = sky.longitude_bins(geometry)
    q = benchmark.pedantic(sky.q_rho, args=(geometry, ensemble, edges), warmup_rounds=1, rounds=5)
    assert q.shape == (2000, len(edges) - 1)


def measured(profiles, draws):
    """PDFs and evidence at the paper's noise."""
    noisy = [q + np.float32(NOISE) * d for q, d in zip(profiles, draws, strict=True)]
    pdfs = measure_pdfs(noisy, 100)
    return pdfs, measure_evidence(pdfs, NOISE)
