"""The app with handlers that raise, of the kinds that ``?fault=`` names; for test_guard.py."""

import os
import sys
from pathlib import Path

import panel as pn

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from app import ui
from app.services.services import process_services
from app.serving import open_session
from app.ui.upload import FileDrop


def fail(kind):
    """A handler that does what nobody has thought of, and leaves word that it was called."""

    called = Path(os.environ["STREAMDASH_FAULTS"])  # when a session ends, this module has lost its names

    def handler(*_):
        with called.open("a", encoding="utf-8") as file:
            file.write(f"{kind}\n")
        raise RuntimeError("a handler raised on purpose")

    return handler


ABOVE = {"position": "fixed", "bottom": "60px", "left": "60px", "z-index": "99999"}
shown = open_session(process_services())
faults = pn.state.session_args.get("fault", [b""])[0].decode().split(",")
document = pn.state.curdoc
pressed = {
    "button": fail("button"),
    "unlocked": lambda *_: pn.state.execute(fail("unlocked"), schedule=True),
}
silent = {
    "periodic": lambda: pn.state.add_periodic_callback(fail("periodic"), 50, count=3),
    "next tick": lambda: document.add_next_tick_callback(fail("next tick")),
    "timeout": lambda: document.add_timeout_callback(fail("timeout"), 50),
    "session destroyed": lambda: pn.state.on_session_destroyed(fail("session destroyed")),
    "document event": lambda: document.on_event("document_ready", fail("document event")),
    "load": lambda: pn.state.onload(fail("load")),
}
for fault in faults:
    if fault in pressed:
        pn.Row(ui.button("Fault", pressed[fault], css_classes=["sd-fault"]), styles=ABOVE).servable()
    elif fault == "download":
        pn.Row(ui.download("fault.csv", "fault", fail(fault)), styles=ABOVE).servable()
    elif fault == "slider":
        slider = ui.number_slider("Fault", 0, 10, 5, "fault")
        slider.param.watch(fail(fault), "value")
        pn.Row(slider, styles=ABOVE).servable()
    elif fault == "upload":
        pn.Row(FileDrop(fail(fault), fail(fault), css_classes=["sd-fault"]), styles=ABOVE).servable()
    elif fault in silent:
        silent[fault]()
shown.servable(title="streamdash")
