"""What a session has chosen on the Convergence page."""

from __future__ import annotations

from typing import Any

import param

from app.session.fields import Field, integer, option
from streamdash.convergence.knobs import KNOBS, N_STREAMS

SEED_MAX = 9999
SIZES = (100, 250, N_STREAMS)
"""Numbers of streams per setting that can be asked for."""

FIELDS: dict[str, Field] = {
    "knob": option(*KNOBS),
    "lab_streams": option(*map(str, SIZES)),
    "lab_seed": integer(0, SEED_MAX),
}


class ConvergenceState(param.Parameterized):
    """Choices of the Convergence page."""

    knob: Any = param.Selector(default=next(iter(KNOBS)), objects=list(KNOBS), doc="test shown")
    lab_streams: Any = param.Selector(
        default=str(N_STREAMS), objects=[str(size) for size in SIZES], doc="streams per setting"
    )
    lab_seed = param.Integer(0, bounds=(0, SEED_MAX), doc="seed of the settings' random numbers")
