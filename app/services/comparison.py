"""What the PDF and Evidence pages share: one comparison of the chosen classes for all sessions."""

from __future__ import annotations

from app.services.services import Services, Unavailable
from app.session.session import Session
from app.work.pieces import noisy_profiles
from streamdash.statistics.evidence import RULES, Comparison, compare


def choice_key(session: Session) -> tuple:
    """Everything that a result of the chosen classes at the chosen noise depends on."""
    return tuple(choice.key for choice in session.ensembles), session.noise, session.exclude


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
