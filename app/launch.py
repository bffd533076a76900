"""Starts Panel's server with what only its Python configuration takes; `streamdash serve` runs this.

The password comes as an environment variable: a command line can be read by every user of a
machine, and Panel's own variable for it, ``PANEL_BASIC_AUTH``, is turned to lower case (1.9.4).
"""

import argparse
import os
import sys
from pathlib import Path

APP = Path(__file__).resolve().parent
sys.path[0] = str(APP.parent)  # not app/ itself, whose modules would hide others of the same names

import panel as pn  # noqa: E402

from app.doors import Serve  # noqa: E402

if __name__ == "__main__":
    password = os.environ.pop("STREAMDASH_PASSWORD", "")
    if password:
        pn.config.basic_auth = password  # type: ignore[misc]
    parser = argparse.ArgumentParser(prog="streamdash serve")
    command = Serve(parser=parser)
    command.embedded_in = os.environ.get("STREAMDASH_EMBEDDED_IN", "").replace(",", " ").split()
    command.invoke(parser.parse_args([str(APP / "main.py"), *sys.argv[1:]]))
