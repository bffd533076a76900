"""What a profile is worth by several methods, on the same held-out streams of one design."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from streamdash.inference.abc import Abc, largest_scales
from streamdash.inference.cells import cell_of
from streamdash.inference.diagnostics import Score, score
from streamdash.inference.estimator import Estimator
from streamdash.inference.files import SHIPPED
from streamdash.inference.network import train
from streamdash.inference.prior_ensemble import PriorEnsemble, observed
from streamdash.inference.training import Training, split_streams
from streamdash.statistics.features import FeatureSet

Progress = Callable[[int, int], None]
METHODS = SHIPPED / "methods.json"
"""The comparison of methods that is shipped, by stream."""

NETWORKS: Mapping[str, FeatureSet] = {
    "network on P(k)": FeatureSet(n_pca=0, summaries=("power",)),
    "network on the profile": FeatureSet(n_pca=1000, summaries=()),
}
"""Networks that see less than an estimator does."""


@dataclass(frozen=True)
class Comparison:
    """Scores of every method, by name, for one parameter."""

    name: str
    scores: Mapping[str, Score]


def compare(
    ensemble: PriorEnsemble,
    estimator: Estimator,
    held_out: tuple[pd.DataFrame, np.ndarray],
    progress: Progress | None = None,
) -> Comparison:
    """ABC, networks on summaries of the field, and an estimator, for the first parameter of its prior.

    Parameters
    ----------
    ensemble : what all of them learn from.
    estimator : of one parameter.
    held_out : fresh streams, as `Estimator.simulate` gives them.

    Raises
    ------
    ValueError
        When the bins are not adjoining and even, which spectra need.
    """
    design, prior = estimator.design, estimator.prior
    name = estimator.names[0]
    edges = np.asarray(estimator.grid[name])
    if not design.gapless or np.ptp(np.abs(design.high - design.low)) > 1e-6:
        raise ValueError("Spectra need bins of one width without gaps.")
    truth, q = held_out
    true = truth[name].to_numpy()
    clean, parameters = ensemble.clean(design), ensemble.parameters()
    split = split_streams(len(clean))
    rng = np.random.default_rng(7)
    found: dict[str, Score] = {}
    known = np.concatenate([split.train, split.validation])
    table = Abc.of(
        observed(clean[known], design, prior, rng), parameters[name].to_numpy()[known], edges, design.step
    )
    found["ABC on three scales of √P"] = score(table.posterior(q, design.step), edges, true)
    p = _on_scales(clean, parameters[name].to_numpy(), split, estimator, q, rng)
    found["network on the same three scales"] = score(p, edges, true)
    training = Training(members=3)
    for number, (method, features) in enumerate(NETWORKS.items()):
        if progress is not None:
            progress(number, len(NETWORKS))
        other = Estimator.learn(
            prior,
            ensemble.stream,
            design,
            {name: edges},
            clean,
            parameters,
            training.model_copy(update={"features": features}),
        )
        found[method] = score(other.posterior(q), edges, true)
    found["streamdash: network on profile and features"] = score(estimator.posterior(q), edges, true)
    return Comparison(name, found)


def shipped_methods(stream: str) -> dict[str, dict[str, float]]:
    """What each method is worth for a named stream in its usual bins, as `streamdash estimator table` found.

    Returns
    -------
    dict
        Method to ``bits``, ``error``, ``width``, ``coverage68``, ``coverage95``; empty where it has not been
        compared.
    """
    try:
        return dict(json.loads(METHODS.read_text(encoding="utf-8")).get(stream, {}))
    except (OSError, ValueError):
        return {}


def _on_scales(
    clean: np.ndarray,
    true: np.ndarray,
    split: tuple[np.ndarray, np.ndarray, np.ndarray],
    estimator: Estimator,
    q: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Posterior (n, n_cell) of a network that sees what ABC sees."""
    design, prior = estimator.design, estimator.prior
    edges = np.asarray(estimator.grid[estimator.names[0]])
    training, validation, _ = split
    first = largest_scales(observed(clean[training], design, prior, rng), design.step)
    mean, std = first.mean(axis=0), first.std(axis=0)

    def inputs(profiles: np.ndarray) -> np.ndarray:
        return ((largest_scales(profiles, design.step) - mean) / std).astype(np.float32)

    cell = cell_of(true, edges)
    network, _ = train(
        lambda _: (inputs(observed(clean[training], design, prior, rng)), cell[training]),
        (inputs(observed(clean[validation], design, prior, rng)), cell[validation]),
        len(edges) - 1,
        seed=0,
        max_epochs=15,
    )
    return np.exp(network.log_probabilities(inputs(q)))


def table(comparisons: Mapping[str, Comparison]) -> str:
    """Scores as a table in Markdown, one row a method; `comparisons` by the design's words."""
    lines = []
    for design, comparison in comparisons.items():
        lines += [
            f"**{design}**",
            "",
            "| method | information (bits) | 68 % width (dex) | coverage of 68 % | of 95 % |",
            "|---|---|---|---|---|",
        ]
        lines += [
            f"| {method} | {s.information:.2f} ± {s.error:.2f} | {s.width:.2f} | {s.coverage[0]:.2f} "
            f"| {s.coverage[1]:.2f} |"
            for method, s in comparison.scores.items()
        ]
        lines.append("")
    return "\n".join(lines)
