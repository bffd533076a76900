"""Copies of Bokeh figures: one that was drawn before, of the same elements, is made again without HoloViews.

HoloViews needs three times as long to draw a figure as Bokeh to make its models anew from what they were
given, and most visitors begin with the same figures.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Hashable, Mapping
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd
from bokeh.core.has_props import HasProps
from bokeh.model import Model

OPTIONS = ("style", "plot", "norm", "output")
"""Groups of HoloViews options."""


class Unknown(TypeError):
    """Something whose equality cannot be told: what it is part of is drawn each time."""


def signature(drawn: hv.Element | hv.Overlay) -> Hashable:
    """Everything a figure depends on: elements, data, labels and options. Equal ones look the same.

    Raises
    ------
    Unknown
        When part of it cannot be compared.
    """
    if isinstance(drawn, hv.Overlay):
        content: Hashable = tuple(signature(part) for part in drawn.values())
    else:
        content = _frozen(drawn.data)
    params = {name: value for name, value in drawn.param.values().items() if name not in ("name", "data")}
    options = {
        group: hv.Store.lookup_options("bokeh", drawn, group).kwargs
        for group in OPTIONS
        if group in hv.Store.options(backend="bokeh").groups
    }
    return type(drawn), content, _frozen(params), _frozen(options)


def _frozen(value: Any) -> Hashable:
    if value is None or isinstance(value, str | bytes | bool | int | float | complex | type | np.generic):
        return type(value), value
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            return "array", value.shape, _frozen(value.ravel().tolist())
        digest = hashlib.blake2b(np.ascontiguousarray(value).tobytes(), digest_size=16).digest()
        return "array", value.dtype.str, value.shape, digest
    if isinstance(value, Mapping):
        return "mapping", tuple((_frozen(key), _frozen(item)) for key, item in value.items())
    if isinstance(value, list | tuple):
        return type(value), tuple(map(_frozen, value))
    if isinstance(value, pd.DataFrame):
        return "frame", tuple((str(name), _frozen(value[name].to_numpy())) for name in value.columns)
    if isinstance(value, hv.Dimension):
        return (
            "dimension",
            _frozen({k: v for k, v in value.param.values().items() if k != "name"}),
            value.name,
        )
    if isinstance(value, hv.core.boundingregion.BoundingBox):
        return "box", value.lbrt()
    if isinstance(value, hv.Cycle | hv.dim):
        return "words", repr(value)
    raise Unknown(f"{type(value).__name__} cannot be compared")


class Template:
    """What the models of a figure were given, to make them again; it holds none of them."""

    def __init__(self, figure: Model) -> None:
        models = list(figure.references())
        self._root = figure.id
        self._given = [(model.id, type(model), _given(model)) for model in models]

    def __contains__(self, ref: object) -> bool:
        """Whether the model of an id is among the figure's."""
        return any(ref == known for known, _, _ in self._given)

    def make(self) -> dict[str, Model]:
        """New models, by the ids of those that the template was made from; arrays are shared."""
        made: dict[str, Model] = {}
        for ref, kind, _ in self._given:
            # As Bokeh makes models of a document it is sent: without what their constructors add.
            model = made[ref] = kind.__new__(kind)
            HasProps.__init__(model)
        for ref, _, given in self._given:
            model = made[ref]
            for name, value in given.items():
                setattr(model, name, _with(value, made))
        return made


@dataclasses.dataclass(frozen=True)
class _Reference:
    ref: str


def _given(model: Model) -> dict[str, Any]:
    """Properties of a model that are not their class's own, references to other models by their ids."""
    values = model.properties_with_values(include_defaults=False)
    return {name: _plain(value) for name, value in values.items() if not model.lookup(name).readonly}


def _plain(value: Any) -> Any:
    if isinstance(value, Model):
        return _Reference(value.id)
    if isinstance(value, dict):
        return {_plain(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        kind = next(one for one in (list, tuple, set) if isinstance(value, one))
        return kind(_plain(item) for item in value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return dataclasses.replace(value, **fields)
    return value


def _with(value: Any, made: Mapping[str, Model]) -> Any:
    """A value of `_plain` with models in place of references, and containers of its own."""
    if isinstance(value, _Reference):
        return made[value.ref]
    if isinstance(value, dict):
        return {_with(key, made): _with(item, made) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return type(value)(_with(item, made) for item in value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _with(getattr(value, f.name), made) for f in dataclasses.fields(value)}
        return dataclasses.replace(value, **fields)
    return value
