"""The repair of Bokeh's stack of documents: what it needs of Bokeh, and what it promises."""

from __future__ import annotations

import gc
import sys

import bokeh.io.doc
import panel as pn
import pytest
from bokeh.document import Document
from bokeh.document.callbacks import invoke_with_curdoc
from bokeh.io import curdoc

from app.guard import FAILED, USERS, repair_curdoc, say_fault
from app.services.services import Unavailable


def fail() -> None:
    raise RuntimeError("on purpose")


def test_an_exception_in_a_handler_leaves_no_document_behind():
    repair_curdoc()
    before = curdoc()
    visitor = Document()
    with pytest.raises(RuntimeError, match="on purpose"):
        invoke_with_curdoc(visitor, fail)
    assert curdoc() is before
    del visitor
    gc.collect()
    assert curdoc() is before


def test_the_document_of_a_handler_is_its_own_and_handlers_nest():
    repair_curdoc()
    outer, inner = Document(), Document()

    def run() -> None:
        with pytest.raises(RuntimeError, match="on purpose"):
            invoke_with_curdoc(inner, fail)
        assert curdoc() is outer

    invoke_with_curdoc(outer, run)


def test_bokeh_still_needs_the_repair():
    """When this fails, Bokeh has mended it and `repair_curdoc` can go."""
    repair_curdoc()
    original = bokeh.io.doc.patch_curdoc.__wrapped__
    before, visitor = curdoc(), Document()
    with pytest.raises(RuntimeError, match="on purpose"), original(visitor):
        fail()
    try:
        assert curdoc() is visitor is not before
    finally:
        bokeh.io.doc._PATCHED_CURDOCS.pop()


def test_every_module_that_uses_it_has_the_repaired_one():
    repair_curdoc()
    holders = [m for name, m in sys.modules.items() if name.startswith(("bokeh", "panel"))]
    found = {m.__name__ for m in holders if "patch_curdoc" in vars(m)}
    assert found == {m.__name__ for m in USERS}
    assert all(m.patch_curdoc is bokeh.io.doc.patch_curdoc for m in USERS)
    once = bokeh.io.doc.patch_curdoc
    repair_curdoc()
    assert bokeh.io.doc.patch_curdoc is once


def test_a_fault_is_said_and_logged_and_what_is_meant_for_people_is_said_as_it_is(caplog, monkeypatch):
    said = []

    class Area:
        def error(self, sentence, duration):
            said.append(sentence)

    monkeypatch.setattr(type(pn.state), "notifications", property(lambda _: Area()))
    say_fault(Unavailable("There is nothing yet."))
    assert said == ["There is nothing yet."] and not caplog.records
    say_fault(ZeroDivisionError("secret"))
    assert said[1:] == [FAILED]
    assert "secret" in caplog.text
