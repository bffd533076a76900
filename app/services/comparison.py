"""What the PDF and Evidence pages share: one comparison of the chosen classes for all sessions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from bokeh.models import Range1d

from app.services.services import Services, Unavailable
from app.session.catalog import Choice
from app.session.session import Session
from streamdash.config import EnsembleConfig
from streamdash.statistics.evidence import RULES, Comparison, compare


def choice_key(session: Session) -> tuple:
    """Everything that a result of the chosen classes at the chosen noise depends on."""
    return tuple(choice.key for choice in session.ensembles), session.noise, session.exclude


def configs(session: Session) -> list[EnsembleConfig]:
    """Configurations of the chosen classes, M0 first."""
    return [choice.config for choice in session.ensembles]


def noisy_profiles(
    services: Services, choices: Sequence[Choice], noise: float, number: int = 0
) -> list[np.ndarray]:
    """Qρ with shot noise of every class, (n_streams, n_longitudes); `number` names another draw of it."""
    return services.observed(choices).noisy(noise, number)


def shared_comparison(services: Services, session: Session) -> Comparison:
    """PDFs and Bayes factors of what is chosen now, computed once for all sessions.

    Raises
    ------
    Unavailable
        When the classes cannot be compared, in one sentence.
    """
    choices, noise, n_bin = session.ensembles, session.noise, session.n_bin
    rules = RULES[session.exclude]

    def compute() -> Comparison:
        return compare(noisy_profiles(services, choices, noise), noise, n_bin, rules)

    try:
        return services.shared(("comparison", n_bin, *choice_key(session)), compute)
    except ValueError as error:
        raise Unavailable(str(error)) from None


def set_range(axis: Range1d, ends: tuple[float, float]) -> None:
    """Move an axis, only if it must move."""
    if (axis.start, axis.end) != ends:
        axis.update(start=ends[0], end=ends[1])


def code_head(session: Session, module: str, function: str, choices: Sequence[Choice] = ()) -> str:
    """First lines of a listing: imports, and the chosen ensembles by key, or other `choices`."""
    chosen = choices or session.ensembles
    ensembles = "\n".join(f'    "{choice.key}",  # {choice.label}' for choice in chosen)
    return (
        "from pathlib import Path\n\n"
        f"from streamdash.plots.{module} import {function}\n"
        "from streamdash.plots.live import export\n"
        "from streamdash.store.cache import Cache\n\n"
        f"ensembles = [\n{ensembles}\n]\n"
    )
