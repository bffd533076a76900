"""From an observed profile to the posterior of what hit the stream, learnt from streams drawn from a prior.

The posterior over a grid of cells is a product, p(a | q) p(b | q, a) …, and a network learns each factor
(a softmax over the cells of one parameter, given features of the profile and the parameters before it),
as the mean of a few members. Streams are split once into training, validation and test: noise is drawn
anew for every copy, but no copy of a stream is in two of them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from streamdash.config import ENGINE_VERSION, StreamModel
from streamdash.inference.calibration import calibrated, curve_of
from streamdash.inference.cells import AGE, all_conditions, cell_of, conditions, grid_of, reflected, unit
from streamdash.inference.diagnostics import marginals, ranks
from streamdash.inference.network import Network, train
from streamdash.inference.nonsense import Critic, alternatives
from streamdash.inference.posterior import Posterior
from streamdash.inference.prior_ensemble import PriorEnsemble, noise_factors, observed
from streamdash.inference.training import Training, one_thread, split_streams
from streamdash.prior import Prior
from streamdash.statistics.features import FeatureMap
from streamdash.store.cache import Cache
from streamdash.survey.design import Design

CLIP = 6.0
"""Features further from their mean than so many standard deviations count as that far."""
STRANGE = 0.99
"""A profile is strange if it looks less like a perturbed stream than this share of them does."""
FEATURELESS = 0.5
"""A profile that varies by less than this share of its errors is a smooth stream's, and not strange."""
POWERS = np.round(np.arange(0.7, 1.51, 0.02), 2)

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Estimator:
    """Posterior of a prior's parameters for profiles observed with one design.

    Attributes
    ----------
    prior : Prior
    stream : StreamModel
    design : Design
    grid : mapping of parameter to edges of its cells
    features : FeatureMap
    center, scale : ndarray (n_feature,)
        Mean and standard deviation of the features.
    critic : Critic
        Tells streams from what no perturber makes.
    factors : for each parameter, the members' networks
    powers : for each parameter, the power that makes their mean as sharp as validation streams want it
    curves : for each parameter, what makes its marginal calibrated on them
        (`streamdash.inference.calibration`)
    card : mapping
        How it was trained, on what, and how well it does on streams it has not seen.
    """

    prior: Prior
    stream: StreamModel
    design: Design
    grid: Mapping[str, np.ndarray]
    features: FeatureMap
    center: np.ndarray
    scale: np.ndarray
    critic: Critic
    factors: tuple[tuple[Network, ...], ...]
    powers: tuple[float, ...]
    curves: tuple[np.ndarray, ...]
    card: Mapping[str, object]

    @classmethod
    def fit(
        cls,
        ensemble: PriorEnsemble,
        design: Design,
        training: Training | None = None,
        progress: Progress | None = None,
    ) -> Estimator:
        """Train for a design on an ensemble of a prior's streams.

        Parameters
        ----------
        progress : called with steps done and all.

        Raises
        ------
        ValueError
            When a bin is not within the profiles.
        """
        training = training or Training()
        with_age = "age" in training.told
        grid, truth = grid_of(ensemble.prior, with_age), ensemble.truth(with_age)
        clean = ensemble.clean(design)
        return cls.learn(ensemble.prior, ensemble.stream, design, grid, clean, truth, training, progress)

    @classmethod
    @one_thread
    def learn(
        cls,
        prior: Prior,
        stream: StreamModel,
        design: Design,
        grid: Mapping[str, np.ndarray],
        clean: np.ndarray,
        truth: pd.DataFrame,
        training: Training,
        progress: Progress | None = None,
    ) -> Estimator:
        """Train on clean profiles (n, n_bin) with known parameters, a column for each of the grid's."""
        split = split_streams(len(clean), training.seed)
        rng, critics = (np.random.default_rng([training.seed, number]) for number in (1, 2))
        copies_in_all = training.copies + 4
        steps = copies_in_all + training.members * training.max_epochs * len(grid)
        count = _Counter(progress, steps)
        told = "noise" in training.told
        penalty = training.penalty(len(split.train))

        def drawn(part: np.ndarray, make: Callable[..., np.ndarray] = observed) -> _Seen:
            # What the networks see does not depend on what the critic is shown.
            source = rng if make is observed else critics
            factors = noise_factors(len(part), prior, source) if told else None
            return _Seen(make(clean[part], design, prior, source, factors), factors)

        first = drawn(split.train)
        features = FeatureMap.fit(first.q, training.features)
        raw = features(first.q)
        center, scale = raw.mean(axis=0), raw.std(axis=0) + 1e-6

        def scaled(seen: _Seen) -> np.ndarray:
            count.step()
            return _with_noise(_scaled(features(seen.q), center, scale), seen.factors, prior)

        copies = [scaled(first)]
        copies += [scaled(drawn(split.train)) for _ in range(training.copies - 1)]
        held = scaled(drawn(split.validation))
        wrong = [scaled(drawn(split.train, alternatives)) for _ in range(2)]
        wrong_held = scaled(drawn(split.validation, alternatives))
        critic = Critic.learn(copies, wrong, held, wrong_held, training.seed, penalty)

        def blurred(name: str) -> np.ndarray:
            # Streams near each other in a parameter hardly differ: their cells are learnt together.
            true, edges = values[name][split.train], np.asarray(grid[name])
            if name == AGE:  # few cells, an age each
                return cell_of(true, edges)
            error = training.blur * np.ptp(edges) * rng.standard_normal(len(true))
            return cell_of(reflected(true + error, edges), edges)

        values = {name: truth[name].to_numpy() for name in grid}
        factors, powers = [], []
        for j, name in enumerate(grid):
            before = conditions(values, grid, list(grid)[:j])
            edges = np.asarray(grid[name])
            cell = cell_of(values[name], edges)
            inputs = [np.hstack([copy, before[split.train]]) for copy in copies]
            valid = np.hstack([held, before[split.validation]]), cell[split.validation]
            members = []
            for member in range(training.members):

                def epoch(
                    number: int, member: int = member, inputs: list[np.ndarray] = inputs, name: str = name
                ) -> tuple[np.ndarray, np.ndarray]:
                    return inputs[(number + member) % len(inputs)], blurred(name)

                network, _ = train(
                    epoch,
                    valid,
                    len(grid[name]) - 1,
                    1000 * training.seed + 10 * j + member,
                    training.max_epochs,
                    penalty,
                    lambda done, _all: count.step(),
                )
                members.append(network)
                count.at(copies_in_all + training.max_epochs * (j * training.members + member + 1))
            factors.append(tuple(members))
            powers.append(_best_power(tuple(members), *valid))
        count.at(steps)
        card = {
            "engine_version": ENGINE_VERSION,
            "n_streams": len(clean),
            "training": training.model_dump(mode="json"),
        }
        return cls(
            prior,
            stream,
            design,
            grid,
            features,
            center,
            scale,
            critic,
            tuple(factors),
            tuple(powers),
            _curves(grid, factors, powers, held, {n: values[n][split.validation] for n in grid}),
            card,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters, in the order of the posterior's axes."""
        return tuple(self.grid)

    @property
    def noise_told(self) -> bool:
        """Whether it answers for other errors than the design's, which it is told."""
        return len(self.critic.network.weights[0]) > len(self.center)

    def posterior(self, q: np.ndarray, noise_factor: float = 1.0) -> np.ndarray:
        """Posterior probability of every cell, (n, *cells); each stream's sum to 1.

        Of what is not like the prior's streams (`strangeness` above `STRANGE`) it is the prior.

        Parameters
        ----------
        q : ndarray (n, n_bin)
            Profiles as the design says they are measured, divided by its polynomial.
        noise_factor : float
            Their errors relative to the design's; only where `noise_told`.

        Raises
        ------
        ValueError
            When the profiles have other bins than the design, a value is not finite, or the errors are not
            ones that it has learnt.
        """
        x = self._inputs(q, noise_factor)
        p = calibrated(_joint(self.grid, self.factors, self.powers, x), self.curves)
        p[self.strangeness(q, noise_factor) > STRANGE] = _uniform(self.grid)
        return p

    def posteriors(self, q: np.ndarray, noise_factor: float = 1.0) -> list[Posterior]:
        """The same as a `Posterior` for each profile."""
        return [Posterior(self.grid, p) for p in self.posterior(q, noise_factor)]

    def strangeness(self, q: np.ndarray, noise_factor: float = 1.0) -> np.ndarray:
        """Share of simulated streams (n,) that look more like perturbed streams than each profile does.

        Above `STRANGE`, the profile is not like the prior's streams: they say nothing about it, and its
        posterior is the prior. What has no structure beyond its errors is not strange: a stream that was
        not hit looks so.
        """
        found = self.critic.strangeness(self._inputs(q, noise_factor))
        varies = np.sqrt(np.mean((np.atleast_2d(q) - 1) ** 2, axis=1))
        return np.where(varies < FEATURELESS * noise_factor * self.design.noise, 0.0, found)

    def simulate(self, n: int, seed: int, cache: Cache | None = None) -> tuple[pd.DataFrame, np.ndarray]:
        """Fresh streams of the prior, observed with the design.

        Parameters
        ----------
        n : how many.
        seed : other seeds give other streams; none are those it has learnt from.

        Returns
        -------
        truth : DataFrame
            Parameters, a column for each of `grid`.
        q : ndarray (n, n_bin)
            What `posterior` takes.
        """
        fresh = PriorEnsemble.fresh(self.prior, self.stream, n, seed, cache)
        rng = np.random.default_rng([seed, 2])
        clean, factors = fresh.clean(self.design), 1.0 if self.noise_told else None
        return fresh.truth(AGE in self.grid), observed(clean, self.design, self.prior, rng, factors)

    def _inputs(self, q: np.ndarray, noise_factor: float = 1.0) -> np.ndarray:
        q = np.atleast_2d(np.asarray(q, np.float32))
        if q.ndim != 2 or q.shape[1] != self.design.n_bin:
            raise ValueError(f"profiles must have {self.design.n_bin} bins (got an array of {q.shape})")
        if not np.isfinite(q).all():
            raise ValueError("profiles must be finite; leave bins without a value out of the design")
        x = _scaled(self.features(q), self.center, self.scale)
        low, high = self.prior.noise_factor if self.noise_told else (1.0, 1.0)
        if not low <= noise_factor <= high:
            raise ValueError(f"noise_factor must lie between {low:g} and {high:g} (got {noise_factor:g})")
        return _with_noise(x, np.full(len(x), noise_factor) if self.noise_told else None, self.prior)


class _Seen(NamedTuple):
    """Observed streams, and the size of their errors where that is told."""

    q: np.ndarray
    factors: np.ndarray | None


def estimator_key(
    prior: Prior, stream: StreamModel, design: Design, n_streams: int, training: Training
) -> str:
    """Hash of all that a trained estimator depends on."""
    parts = [prior.key, stream.key, design.key, n_streams, training.key, ENGINE_VERSION]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def _scaled(x: np.ndarray, center: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.clip((x - center) / scale, -CLIP, CLIP).astype(np.float32)


def _with_noise(x: np.ndarray, factors: np.ndarray | None, prior: Prior) -> np.ndarray:
    """Inputs with one more where errors are told: their logarithm from -1 to 1 over the prior's range."""
    if factors is None:
        return x
    told = unit(np.log(factors), np.log(prior.noise_factor)).astype(np.float32)
    return np.hstack([x, told[:, None]])


def _joint(
    grid: Mapping[str, np.ndarray],
    factors: Sequence[tuple[Network, ...]],
    powers: Sequence[float],
    x: np.ndarray,
) -> np.ndarray:
    """The product of all factors, (n, *cells), for scaled features."""
    names, n_cells = tuple(grid), [len(edges) - 1 for edges in grid.values()]
    p = np.ones((len(x), 1))
    for j, members in enumerate(factors):
        extra = all_conditions(grid, names[:j]) if j else None
        rows = max(1, 200_000 // (1 if extra is None else len(extra)) // 10)
        factor = np.concatenate(
            [_mean_of(members, powers[j], x[i : i + rows], extra) for i in range(0, len(x), rows)]
        )
        p = (p[:, :, None] * factor.reshape(len(x), p.shape[1], n_cells[j])).reshape(len(x), -1)
    p /= p.sum(axis=1, keepdims=True)
    return p.reshape(len(x), *n_cells)


def _curves(
    grid: Mapping[str, np.ndarray],
    factors: Sequence[tuple[Network, ...]],
    powers: Sequence[float],
    x: np.ndarray,
    truth: Mapping[str, np.ndarray],
) -> tuple[np.ndarray, ...]:
    """For each parameter, the curve that calibrates its marginal on streams of known parameters."""
    p = _joint(grid, factors, powers, x)
    return tuple(curve_of(ranks(marginals(p, grid, n), np.asarray(grid[n]), truth[n])) for n in grid)


def _uniform(grid: Mapping[str, np.ndarray]) -> np.ndarray:
    """Prior probability of every cell (*cells)."""
    shape = tuple(len(edges) - 1 for edges in grid.values())
    return Posterior(grid, np.ones(shape)).prior


def _mean_of(
    members: tuple[Network, ...], power: float, x: np.ndarray, extra: np.ndarray | None = None
) -> np.ndarray:
    mean = np.mean([np.exp(member.log_probabilities(x, extra)) for member in members], axis=0)
    sharp = np.maximum(mean, 1e-12) ** power
    return sharp / sharp.sum(axis=-1, keepdims=True)


def _best_power(members: tuple[Network, ...], x: np.ndarray, cell: np.ndarray) -> float:
    """The power under which the true cells of validation streams are most probable.

    A mean over members, and blurred cells, are wider than the posterior is.
    """
    logs = np.log(_mean_of(members, 1.0, x.astype(np.float32)))
    rows = np.arange(len(x))

    def loss(power: float) -> float:
        scaled = power * logs
        return float((np.log(np.exp(scaled).sum(axis=1)) - scaled[rows, cell]).mean())

    return float(min(POWERS, key=loss))


class _Counter:
    """Progress over several loops."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self.progress, self.total, self.done = progress, total, 0

    def step(self) -> None:
        self.at(self.done + 1)

    def at(self, done: int) -> None:
        self.done = min(done, self.total)
        if self.progress is not None:
            self.progress(self.done, self.total)
