"""The app with one handler that raises, of the kind that ``?fault=`` names; for test_guard.py.

The file that the variable ``FAULTS`` names gets a line when the handler raises and when its session is gone.
"""

import os
import sys
from pathlib import Path

import panel as pn

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from app import ui
from app.services.services import process_services
from app.serving import open_session
from app.ui.upload import FileDrop


def note(event):
    """Tell the test."""
    with Path(os.environ["FAULTS"]).open("a") as file:
        file.write(f"{fault}: {event}\n")


def fail(*_):
    """What a handler does that nobody has thought of."""
    note("raised")
    raise RuntimeError("a handler raised on purpose")


def fail_at_the_end():
    """Have the end of the session raise."""
    pn.state.on_session_destroyed(fail)
    note("asked")


ABOVE = {"position": "fixed", "bottom": "60px", "left": "60px", "z-index": "99999"}
fault = pn.state.session_args.get("fault", [b""])[0].decode()
shown = open_session(process_services())
pn.state.on_session_destroyed(lambda _: note("gone"))
document = pn.state.curdoc
pressed = {
    "button": fail,
    "periodic": lambda: pn.state.add_periodic_callback(fail, 50, count=3),
    "next tick": lambda: document.add_next_tick_callback(fail),
    "timeout": lambda: document.add_timeout_callback(fail, 50),
    "session destroyed": fail_at_the_end,
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
