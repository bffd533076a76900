"""The app with one handler that raises, of the kind that ``?fault=`` names; for test_guard.py."""

import sys
from pathlib import Path

import panel as pn

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from app import ui
from app.services.services import process_services
from app.serving import open_session
from app.ui.upload import FileDrop


def fail(*_):
    """What a handler does that nobody has thought of."""
    raise RuntimeError("a handler raised on purpose")


ABOVE = {"position": "fixed", "bottom": "60px", "left": "60px", "z-index": "99999"}
shown = open_session(process_services())
fault = pn.state.session_args.get("fault", [b""])[0].decode()
document = pn.state.curdoc
pressed = {
    "button": fail,
    "periodic": lambda: pn.state.add_periodic_callback(fail, 50, count=3),
    "next tick": lambda: document.add_next_tick_callback(fail),
    "timeout": lambda: document.add_timeout_callback(fail, 50),
    "session destroyed": lambda: pn.state.on_session_destroyed(fail),
    "unlocked": lambda: pn.state.execute(fail, schedule=True),
}
if fault in pressed:
    pn.Row(ui.button("Fault", pressed[fault], css_classes=["sd-fault"]), styles=ABOVE).servable()
elif fault == "download":
    pn.Row(ui.download("fault.csv", "fault", fail), styles=ABOVE).servable()
elif fault == "slider":
    slider = ui.number_slider("Fault", 0, 10, 5, "fault")
    slider.param.watch(fail, "value")
    pn.Row(slider, styles=ABOVE).servable()
elif fault == "upload":
    pn.Row(FileDrop(fail, fail, css_classes=["sd-fault"]), styles=ABOVE).servable()
elif fault == "document event":
    document.on_event("document_ready", fail)
elif fault == "load":
    pn.state.onload(fail)
shown.servable(title="streamdash")
