"""What the Infer page remembers. The file is the Observe page's; what was answered before is in no link."""

from __future__ import annotations

import param

from app.session.fields import Decimal, OneOf, Whole
from streamdash.prior import PRIORS

PRIOR_WORDS = {"rate": "abundance alone (10⁶–10⁹ M☉)", "population": "abundance, half-mode mass, clusters"}
SOURCE_WORDS = {"mock": "Mock", "simulated": "Simulated", "upload": "My file"}
WINDOW_WORDS = {"whole": "whole", "first": "first half", "second": "second half"}
AGES = ("usual", "open", "3", "5", "7", "9")
"""The age that the literature favours, none, or one that is fixed (Gyr)."""
ERRORS = (0.25, 2.0)
"""Errors relative to the stream's usual ones."""


class InferState(param.Parameterized):
    """Choices of the Infer page, to be inherited by `app.session.session.Session`."""

    infer_prior = OneOf("rate", {name: PRIOR_WORDS.get(name, name) for name in PRIORS}, doc="prior by name")
    infer_data = OneOf("mock", SOURCE_WORDS, doc="where the profile comes from")
    infer_number = Whole(1, (1, 9999), softbounds=(1, 100), doc="which mock, or stream of the ensemble")
    infer_class = Whole(0, (0, 99), doc="which ensemble of the stream, for simulated data")
    infer_errors = Decimal(1.0, ERRORS, doc="errors relative to the stream's usual ones")
    infer_age = OneOf("usual", AGES, doc="age that is taken as known, Gyr")
    infer_window = OneOf("whole", WINDOW_WORDS, doc="part of the stretch that is used")
    infer_kept = param.List([], doc="answers put aside to be joined; in no link")
