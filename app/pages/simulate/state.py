"""What the Simulate page remembers: the text of every knob, and the name that the ensemble is to have."""

from __future__ import annotations

from functools import partial

import param

from app.pages.simulate.knobs import KNOBS, check
from app.session.fields import Field
from streamdash.store.titles import check_title


class SimulateState(param.Parameterized):
    """Parameters ``sim_…`` of a session: one text per knob (`KNOBS`), and ``sim_title``."""

    sim_title = param.String("", doc="name that somebody gives to the ensemble; untrusted text")


for _knob in KNOBS:
    SimulateState.param.add_parameter(_knob.name, param.String(_knob.default, doc=_knob.help))

FIELDS = {
    **{knob.name: Field(partial(check, knob), str) for knob in KNOBS},
    "sim_title": Field(check_title, str),
}
