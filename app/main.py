"""Entry of the web app, for ``streamdash serve`` and ``panel serve app/main.py``.

The server runs this file once per browser session; everything lasting is in `app.services.services`.
"""

import sys
from pathlib import Path

# `panel serve` puts app/ itself on the path, not the folder that holds the package.
_root = str(Path(__file__).resolve().parent.parent)
if _root not in sys.path:
    sys.path.insert(0, _root)

from app.services.services import process_services  # noqa: E402
from app.serving import open_session  # noqa: E402

open_session(process_services()).servable(title="streamdash")
