"""What the Simulate page remembers: the text of every knob, and the name that the ensemble is to have."""

from __future__ import annotations

from functools import partial

import param

from app.pages.simulate.knobs import KNOBS, NAMED, check
from app.session.fields import OneOf, Text
from streamdash.store.titles import check_title
from streamdash.streams import STREAM_NAMES, named_stream


class SimulateState(param.Parameterized):
    """Fields ``sim_…`` of a session: the stream, one text per knob (`KNOBS`), and ``sim_title``."""

    sim_stream: str
    sim_title: str


SimulateState.param.add_parameter(
    NAMED,
    OneOf(
        STREAM_NAMES[0],
        {name: named_stream(name).title for name in STREAM_NAMES},
        doc="stream by name that the knobs start from",
    ),
)
for _knob in KNOBS:
    SimulateState.param.add_parameter(_knob.name, Text(_knob.default, partial(check, _knob), doc=_knob.help))
SimulateState.param.add_parameter(
    "sim_title", Text("", check_title, doc="name that somebody gives to the ensemble; untrusted text")
)
