"""What the Observe page remembers. A profile itself, and what its columns are, is never in a link."""

from __future__ import annotations

from dataclasses import dataclass

import param

from app.session.fields import OneOf
from streamdash.observe.guess import KINDS
from streamdash.observe.observation import NAMES
from streamdash.survey.design import AS_IS, ORDER_MAX

AUTO = "auto"
"""Leaves a choice to what the columns look like."""
ORDERS = tuple(str(order) for order in range(AS_IS, ORDER_MAX + 1))
COORDINATES = tuple(NAMES)

LINKED = {"kind": "profile_kind", "order": "profile_order", "coordinate": "profile_coordinate"}
"""Assumptions that stand in links, and the session parameters that hold them."""


@dataclass(frozen=True)
class Upload:
    """A file somebody chose: its bytes and its name, nothing else of it is kept."""

    data: bytes
    name: str = ""


class ObserveState(param.Parameterized):
    """Choices of the Observe page, to be inherited by `app.session.session.Session`."""

    example = OneOf("no", ("no", "yes"), doc="whether the example is looked at")
    profile_kind = OneOf(AUTO, (AUTO, *KINDS), doc="what was measured")
    profile_order = OneOf(AUTO, (AUTO, *ORDERS), doc="polynomial divided out")
    profile_coordinate = OneOf(AUTO, (AUTO, *COORDINATES), doc="coordinate of the bins")
    upload = param.ClassSelector(class_=Upload, default=None, doc="the file that was chosen; in no link")
    columns = param.Dict(default={}, doc="assumptions about its columns that were changed; in no link")
