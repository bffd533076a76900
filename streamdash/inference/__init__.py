"""Which population hit a stream: a posterior of its parameters from a measured density.

`load_estimator` gives a trained estimator of a named stream, `Estimator.fit` trains one for any design.
"""

from streamdash._public import offer

PUBLIC = {
    "Estimator": "streamdash.inference.estimator",
    "Posterior": "streamdash.inference.posterior",
    "Prior": "streamdash.prior",
    "PriorEnsemble": "streamdash.inference.prior_ensemble",
    "Training": "streamdash.inference.estimator",
    "default_design": "streamdash.inference.prior_ensemble",
    "load_estimator": "streamdash.inference.files",
}
"""Module of each public name."""

__all__ = list(PUBLIC)

__getattr__, __dir__ = offer(__name__, PUBLIC)
