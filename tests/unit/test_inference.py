"""Estimators: problems with a known answer, streams in one part only, files, and the field's way."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from streamdash.config import StreamModel
from streamdash.inference import estimator as module
from streamdash.inference.abc import Abc
from streamdash.inference.cells import cell_of
from streamdash.inference.diagnostics import bits, coverage, joint_bits, ranks, scores, tarp
from streamdash.inference.estimator import Estimator
from streamdash.inference.files import EstimatorFileError, load, save
from streamdash.inference.nonsense import alternatives, scrambled
from streamdash.inference.posterior import make_grid
from streamdash.inference.prior_ensemble import configs, observed
from streamdash.inference.training import Training, split_streams
from streamdash.prior import RATE, Prior
from streamdash.survey.design import Design

N_BIN = 30
SMALL = Training(members=2, max_epochs=25, copies=2)


def design(noise: float = 0.0, n_bin: int = N_BIN, order: int = -1) -> Design:
    edges = np.linspace(170, 170 + 2 * n_bin, n_bin + 1)
    return Design("ell", edges[:-1], edges[1:], np.full(n_bin, noise), "q_rho", order)


@pytest.fixture(scope="module")
def counts():
    """Poisson counts of a rate e^θ in every bin, with θ Gaussian: the posterior is known."""
    rng = np.random.default_rng(0)
    theta = np.clip(rng.normal(0, 0.5, 8000), -1.5, 1.5)
    clean = rng.poisson(0.3 * np.exp(theta)[:, None], (len(theta), N_BIN)).astype(np.float32)
    return theta, clean


@pytest.fixture(scope="module")
def poisson(counts):
    theta, clean = counts
    grid = make_grid({"log10_rate": (-1.5, 1.5)}, {"log10_rate": 30})
    truth = pd.DataFrame({"log10_rate": theta})
    return Estimator.learn(RATE, StreamModel(), design(), grid, clean, truth, SMALL)


def exact(total: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Posterior probability of every cell given the sum of the counts, a sufficient statistic."""
    fine = np.linspace(edges[0], edges[-1], 20 * (len(edges) - 1) + 1)
    middle = 0.5 * (fine[1:] + fine[:-1])
    log = stats.norm(0, 0.5).logpdf(middle) + stats.poisson.logpmf(
        total[:, None], 0.3 * N_BIN * np.exp(middle)
    )
    p = np.exp(log - log.max(axis=1, keepdims=True)).reshape(len(total), -1, 20).sum(axis=2)
    return p / p.sum(axis=1, keepdims=True)


def test_poisson_counts_with_a_gaussian_prior_give_the_known_posterior(poisson):
    rng = np.random.default_rng(1)
    theta = np.clip(rng.normal(0, 0.5, 600), -1.5, 1.5)
    q = rng.poisson(0.3 * np.exp(theta)[:, None], (len(theta), N_BIN)).astype(np.float32)
    edges = poisson.grid["log10_rate"]
    p, known = poisson.posterior(q), exact(q.sum(axis=1), edges)
    assert p.shape == (600, 30) and np.allclose(p.sum(axis=1), 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    assert np.abs(p @ middle - known @ middle).mean() < 0.06  # a quarter of the posterior's width
    widths = [np.sqrt(x @ middle**2 - (x @ middle) ** 2) for x in (p, known)]
    assert np.median(widths[0] / widths[1]) == pytest.approx(1, abs=0.12)
    lost = bits(known, edges, theta).mean() - bits(p, edges, theta).mean()
    assert lost < 0.08
    rank = ranks(p, edges, theta)
    assert coverage(rank, 0.68) == pytest.approx(0.68, abs=0.07)
    assert coverage(rank, 0.95) == pytest.approx(0.95, abs=0.035)


def test_two_parameters_are_inferred_together():
    """Level and slope of a line with Gaussian errors: both are known, and so is their joint posterior."""
    rng = np.random.default_rng(2)
    x = np.linspace(-1, 1, N_BIN)
    truth = pd.DataFrame({"log10_rate": rng.uniform(-1, 1, 6000), "slope": rng.uniform(-1, 1, 6000)})

    def lines(t: pd.DataFrame) -> np.ndarray:
        return (1 + 0.3 * t.log10_rate.to_numpy()[:, None] + 0.3 * t.slope.to_numpy()[:, None] * x).astype(
            "f4"
        )

    grid = make_grid({"log10_rate": (-1, 1), "slope": (-1, 1)}, {"log10_rate": 16, "slope": 12})
    wide = design(0.4)
    found = Estimator.learn(RATE, StreamModel(), wide, grid, lines(truth), truth, SMALL)
    fresh = pd.DataFrame({name: rng.uniform(-1, 1, 500) for name in grid})
    q = observed(lines(fresh), wide, RATE, rng)
    p = found.posterior(q)
    assert p.shape == (500, 16, 12) and np.allclose(p.sum(axis=(1, 2)), 1)
    level, slope = (0.5 * (edges[1:] + edges[:-1]) for edges in grid.values())
    model = 1 + 0.3 * level[:, None, None] + 0.3 * slope[:, None] * x
    chi2 = ((q[:, None, None] - model) ** 2).sum(axis=-1) / 0.4**2
    known = np.exp(-0.5 * (chi2 - chi2.min(axis=(1, 2), keepdims=True)))
    known /= known.sum(axis=(1, 2), keepdims=True)
    assert joint_bits(known, grid, fresh).mean() - joint_bits(p, grid, fresh).mean() < 0.25
    best = scores(known, grid, fresh)
    for name, score in scores(p, grid, fresh).items():
        assert best[name].information - 0.15 < score.information < best[name].information + 0.05
        assert score.coverage[0] == pytest.approx(0.68, abs=0.08)
    rank = tarp(p, grid, fresh, ("log10_rate", "slope"), rng)
    assert stats.kstest(rank, "uniform").statistic < 0.09
    assert joint_bits(p, grid, fresh).mean() > 1


def test_no_stream_is_in_two_parts():
    for n in (10, 997, 20_000):
        split = split_streams(n)
        every = np.concatenate(split)
        assert len(every) == n and np.array_equal(np.sort(every), np.arange(n))
        assert 0.08 * n - 1 <= len(split.test) <= 0.12 * n + 1


def test_training_sees_no_noise_copy_of_another_part(counts, monkeypatch):
    """Every profile is marked with its stream's number; what is learnt from must be of the training part."""
    theta, clean = counts
    clean = clean[:500].copy()
    clean[:, 0] = np.arange(500)
    seen: list[set[int]] = []
    real = module.observed

    def watched(q, *rest):
        seen.append(set(q[:, 0].astype(int)))
        return real(q, *rest)

    monkeypatch.setattr(module, "observed", watched)
    grid = make_grid({"log10_rate": (-1.5, 1.5)}, {"log10_rate": 10})
    truth = pd.DataFrame({"log10_rate": theta[:500]})
    training = Training(members=1, max_epochs=2, copies=3)
    Estimator.learn(RATE, StreamModel(), design(), grid, clean, truth, training)
    split = split_streams(500)
    assert len(seen) == 4
    assert all(part == set(split.train) for part in seen[:3]) and seen[3] == set(split.validation)
    assert not any(part & set(split.test) for part in seen)


def test_fresh_streams_are_not_those_of_training():
    trained, fresh = (configs(RATE, StreamModel(), 10, seed)[0] for seed in (1, 2**32 + 1))
    assert trained.key != fresh.key and trained.seed != fresh.seed


def test_ages_share_the_streams():
    prior = Prior(ages_gyr=(9.0, 7.0, 5.0))
    made = configs(prior, StreamModel(), 10, 1)
    assert [c.n_streams for c in made] == [4, 3, 3]
    assert [c.stream.age_gyr for c in made] == [9.0, 7.0, 5.0]
    assert made[0].stream == StreamModel()


def test_nuisances_of_the_observation():
    rng = np.random.default_rng(0)
    flat = np.ones((4000, N_BIN), np.float32)
    waves = observed(flat, design(), Prior(background=0.1, background_deg=20), rng)
    assert waves.std() == pytest.approx(0.1, rel=0.1)
    assert np.corrcoef(waves[:, 0], waves[:, 1])[0, 1] > 0.9 > np.corrcoef(waves[:, 0], waves[:, 25])[0, 1]
    noisy = observed(flat, design(0.1), Prior(noise_factor=(2, 2)), rng)
    assert noisy.std() == pytest.approx(0.2, rel=0.02)
    spread = observed(flat, design(0.1), Prior(noise_factor=(0.5, 2)), rng).std(axis=1)
    assert spread.min() < 0.06 and spread.max() > 0.17


def test_file_there_and_back_and_nothing_is_unpickled(poisson, counts, tmp_path):
    save(poisson, tmp_path / "one.npz")
    again = load(tmp_path / "one.npz")
    q = counts[1][:20]
    assert np.allclose(again.posterior(q), poisson.posterior(q), atol=1e-6)
    assert np.allclose(again.strangeness(q), poisson.strangeness(q), atol=0.01)
    assert again.prior == poisson.prior and again.design.key == poisson.design.key
    with np.load(tmp_path / "one.npz", allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)


@pytest.mark.parametrize("damage", ["missing", "cut", "text", "pickled", "empty"])
def test_damaged_files_are_refused_by_name(poisson, damage, tmp_path):
    path = tmp_path / "broken.npz"
    save(poisson, path)
    if damage == "missing":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:5000])
    elif damage == "text":
        path.write_text("not an estimator")
    elif damage == "pickled":
        np.savez(path, card=np.array([{"format": "x"}], dtype=object))
    else:
        np.savez(path, card=np.frombuffer(b"{}", np.uint8))
    with pytest.raises(EstimatorFileError, match="broken.npz"):
        load(path)


def test_profiles_that_do_not_fit_are_refused(poisson):
    with pytest.raises(ValueError, match="30 bins"):
        poisson.posterior(np.ones((1, 31)))
    with pytest.raises(ValueError, match="finite"):
        poisson.posterior(np.full((1, 30), np.nan))


def test_abc_finds_the_amplitude_of_waves():
    rng = np.random.default_rng(3)
    x = np.arange(120)
    true = rng.uniform(-1, 1, 6000)
    phase = rng.uniform(0, 2 * np.pi, (6000, 1))
    q = 1 + 0.1 * 10 ** true[:, None] * np.sin(2 * np.pi * 2 * x / 120 + phase)
    q += 0.02 * rng.standard_normal(q.shape)
    edges = np.linspace(-1, 1, 41)
    p = Abc.of(q[:5500], true[:5500], edges, 0.5).posterior(q[5500:], 0.5)
    assert np.allclose(p.sum(axis=1), 1)
    assert bits(p, edges, true[5500:]).mean() > 1.5
    assert np.abs(p @ (0.5 * (edges[1:] + edges[:-1])) - true[5500:]).mean() < 0.1


def test_alternatives_keep_the_power_of_what_they_are_made_from():
    rng = np.random.default_rng(4)
    clean = (1 + 0.2 * rng.standard_normal((50, 64)).cumsum(axis=1) / 8).astype(np.float32)
    other = scrambled(clean, rng)
    power = [np.abs(np.fft.rfft(q - q.mean(axis=1, keepdims=True), axis=1))[:, 1:-1] for q in (clean, other)]
    assert np.allclose(*power, atol=1e-3) and not np.allclose(clean, other, atol=0.05)
    made = alternatives(clean, design(0.1, 64), RATE, rng)
    assert made.shape == clean.shape and np.isfinite(made).all()


def test_cells_hold_their_edges():
    edges = np.linspace(-1, 1, 5)
    assert cell_of(np.array([-2, -1, -0.5, 0.99, 1, 3]), edges).tolist() == [0, 0, 1, 3, 3, 3]
