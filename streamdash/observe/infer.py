"""Which population hit a measured stream: a posterior for the profile's own bins, errors and gaps."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from streamdash.config import ConfigError, StreamModel
from streamdash.inference.estimator import STRANGE, Estimator, estimator_key
from streamdash.inference.files import (
    DEFAULT_PRIOR,
    EstimatorFileError,
    keep,
    kept,
    load_estimator,
)
from streamdash.inference.held_out import HeldOut, keep_streams, kept_streams
from streamdash.inference.posterior import Posterior
from streamdash.inference.prior_ensemble import PriorEnsemble
from streamdash.inference.shipped_streams import load_shipped
from streamdash.inference.training import Training
from streamdash.inference.words import sentences
from streamdash.observe.guess import assume
from streamdash.observe.observation import Observation, interpret
from streamdash.observe.table import MAX_BYTES, read_table
from streamdash.prior import PRIORS, Prior
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.streams import named_stream
from streamdash.survey.design import Design

N_STREAMS = 5_000
"""Streams that an estimator for somebody's own design learns from, where none of its prior are shipped."""
QUICK = Training(members=3, copies=4, max_epochs=30)
"""How such an estimator is trained: within a minute on two cores."""

Report = Callable[[str, int, int], None]
"""Called with what is being done, steps done and all."""


@dataclass(frozen=True, eq=False)
class Inference:
    """The answer to one profile.

    Attributes
    ----------
    posterior : Posterior
    prior : Prior
    strangeness : float
        Share of simulated streams that look more like perturbed streams than this profile.
    observation : Observation
    estimator : Estimator
    """

    posterior: Posterior
    prior: Prior
    strangeness: float
    observation: Observation
    estimator: Estimator

    @property
    def strange(self) -> bool:
        """Whether the profile is not like the simulated streams, so that the posterior means nothing."""
        return self.strangeness > STRANGE

    @property
    def sentences(self) -> list[str]:
        """The answer in words; first of all a warning, where there is one."""
        words = sentences(self.posterior, self.prior)
        if self.strange:
            warning = (
                "This profile is not like streams hit by subhalos, whatever their number: fewer than "
                f"{1 - STRANGE:.0%} of the simulated ones look so unlike them. Nothing is inferred: what "
                "follows is the prior."
            )
            words.insert(0, warning)
        return words

    def report(self) -> dict[str, Any]:
        """The answer as plain numbers and texts, for JSON."""
        post = self.posterior
        return {
            "answer": self.sentences,
            "strange": self.strange,
            "strangeness": round(float(self.strangeness), 4),
            "information_bits": round(post.information, 3),
            "parameters": {
                name: {
                    "median": round(post.median(name), 4),
                    "interval68": [round(x, 4) for x in post.interval(name, 0.68)],
                    "interval95": [round(x, 4) for x in post.interval(name, 0.95)],
                    "upper95": round(post.upper_limit(name), 4),
                    "lower95": round(post.lower_limit(name), 4),
                    "information_bits": round(post.information_on(name), 3),
                    "at_edge": list(post.edges_reached(name)),
                    "edges": [round(float(x), 6) for x in post.grid[name]],
                    "probability": [round(float(x), 6) for x in post.marginal(name)],
                }
                for name in post.names
            },
            "prior": self.prior.model_dump(mode="json"),
            "assumptions": list(self.observation.stated),
            "bins": self.observation.design.n_bin,
            "estimator": dict(self.estimator.card),
        }


def infer(
    profile: Path | str | bytes | pd.DataFrame,
    stream: str = "gd1-like",
    prior: str | Prior = DEFAULT_PRIOR,
    arm: str | None = None,
    changes: dict[str, Any] | None = None,
    cache: Cache | None = None,
    n_streams: int | None = None,
    progress: Report | None = None,
    kept_in: Path | None = None,
) -> Inference:
    """Posterior of the population that hit a measured stream.

    An estimator is trained for the profile's own bins, errors, gaps and polynomial, and kept. It learns from
    the streams of the prior that are shipped; those of other priors are simulated before, unless the cache
    has them.

    Parameters
    ----------
    profile : a file, its bytes, or a table: positions, values and errors.
    stream, arm : name of the stream, and of its arm.
    prior : "rate", "population", or a `Prior`.
    changes : what the columns are, where the guess is wrong; see `streamdash.observe.guess.assume`.
    n_streams : streams of the prior to learn from; all that are shipped, or else `N_STREAMS`.
    kept_in : folder for trained estimators; one in the user's cache folder by default.

    Raises
    ------
    ValueError
        In one sentence, when the profile or a choice cannot be used.
    """
    cache = cache if cache is not None else Cache.default()
    asked = _prior(prior)
    model = named_stream(stream).arm(arm)
    table = read_table(_bytes(profile))
    observation = interpret(table, assume(table, changes), load_geometry(model, cache))
    design = observation.design
    estimator = _shipped(stream, asked, observation, arm)
    if estimator is None:
        estimator, _ = learnt(asked, model, design, cache, n_streams, progress, kept_in)
    return answer(estimator, observation)


def learnt(
    prior: Prior,
    model: StreamModel,
    design: Design,
    cache: Cache | None = None,
    n_streams: int | None = None,
    progress: Report | None = None,
    kept_in: Path | None = None,
    nice: int = 0,
) -> tuple[Estimator, HeldOut]:
    """The estimator for a design and streams that it has not seen: kept ones, or learnt now and kept.

    Parameters
    ----------
    n_streams : streams of the prior; all that are shipped by default. More, or those of a prior that none
        are shipped of (`N_STREAMS` by default), are simulated before unless the cache has them.
    progress : called all the time; what it raises ends the work.
    nice : how much the simulating processes stand back for others.
    """
    ensemble = load_shipped(prior, model, n_streams, cache)
    n_streams = n_streams or (ensemble.n_streams if ensemble else N_STREAMS)
    key = estimator_key(prior, model, design, n_streams, QUICK)
    there = kept(key, kept_in), kept_streams(key, kept_in)
    if there[0] is not None and there[1] is not None:
        return there[0], there[1]
    report = progress or (lambda _what, _done, _all: None)
    ensemble = ensemble or PriorEnsemble.load(
        prior,
        model,
        n_streams,
        cache,
        progress=lambda d, n: report("Simulating streams of the prior", d, n),
        nice=nice,
    )
    estimator = Estimator.fit(
        ensemble, design, QUICK, lambda d, n: report("Learning from streams so observed", d, n)
    )
    streams = HeldOut.of_test(ensemble, estimator, QUICK.seed)
    keep(key, estimator, kept_in)
    keep_streams(key, streams, kept_in)
    return estimator, streams


def answer(estimator: Estimator, observation: Observation) -> Inference:
    """The answer of an estimator that was trained for the observation's design."""
    q = observation.q[None].astype(np.float32)
    return Inference(
        estimator.posteriors(q)[0],
        estimator.prior,
        float(estimator.strangeness(q)[0]),
        observation,
        estimator,
    )


def _prior(prior: str | Prior) -> Prior:
    if isinstance(prior, Prior):
        return prior
    if prior not in PRIORS:
        raise ConfigError(f"prior: {str(prior)[:40]!r} is none of {', '.join(PRIORS)}.")
    return PRIORS[prior]


def _shipped(stream: str, prior: Prior, observation: Observation, arm: str | None) -> Estimator | None:
    """The shipped estimator, if the profile is observed just as it was trained."""
    name = next((name for name, known in PRIORS.items() if known == prior), None)
    if name is None:
        return None
    try:
        estimator = load_estimator(stream, name)
    except EstimatorFileError:
        return None
    same = estimator.design.key == observation.design.key
    return estimator if same and estimator.stream == named_stream(stream).arm(arm) else None


def _bytes(profile: Path | str | bytes | pd.DataFrame) -> bytes:
    if isinstance(profile, pd.DataFrame):
        text = io.StringIO()
        profile.to_csv(text, index=False)
        return text.getvalue().encode()
    if isinstance(profile, bytes):
        return profile
    try:
        with Path(profile).open("rb") as file:
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ValueError(f"{profile} cannot be read ({error.strerror}).") from None
