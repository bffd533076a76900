"""What the Simulate page remembers: the text of every knob, and the name that the ensemble is to have."""

from __future__ import annotations

from functools import partial

import param

from app.pages.simulate.knobs import KNOBS, check
from app.session.fields import Text
from streamdash.store.titles import check_title


class SimulateState(param.Parameterized):
    """Fields ``sim_…`` of a session: one text per knob (`KNOBS`), and ``sim_title``."""

    sim_title: str


for _knob in KNOBS:
    SimulateState.param.add_parameter(_knob.name, Text(_knob.default, partial(check, _knob), doc=_knob.help))
SimulateState.param.add_parameter(
    "sim_title", Text("", check_title, doc="name that somebody gives to the ensemble; untrusted text")
)
