"""What a session has chosen on the Convergence page."""

from __future__ import annotations

import param

from app.session.fields import OneOf, Whole
from streamdash.convergence.knobs import KNOBS, N_STREAMS, knob


class ConvergenceState(param.Parameterized):
    """Choices of the Convergence page."""

    knob = OneOf(next(iter(KNOBS)), {key: knob(key).title for key in KNOBS}, doc="test shown")
    lab_streams = OneOf(str(N_STREAMS), ("100", "250", str(N_STREAMS)), doc="streams per setting")
    lab_seed = Whole(0, (0, 9999), softbounds=(0, 99), doc="seed of the settings' random numbers")
