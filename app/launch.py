"""Starts Panel's server with what only its Python configuration takes; `streamdash serve` runs this.

The password comes as an environment variable: a command line can be read by every user of a
machine, and Panel's own variable for it, ``PANEL_BASIC_AUTH``, is turned to lower case (1.9.4).
"""

import os
import sys
from pathlib import Path

APP = Path(__file__).resolve().parent
sys.path[0] = str(APP.parent)  # not app/ itself, whose modules would hide others of the same names

import panel as pn  # noqa: E402
from panel.command import main  # noqa: E402

if __name__ == "__main__":
    password = os.environ.pop("STREAMDASH_PASSWORD", "")
    if password:
        pn.config.basic_auth = password  # type: ignore[misc]
    sys.argv[:1] = ["panel", "serve", str(APP / "main.py")]
    main()
