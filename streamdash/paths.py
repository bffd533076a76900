"""Where the parts stand that are not the library: the dashboard, the shipped simulations, the texts.

In a checkout they stand beside the package; a wheel carries them inside it, in ``streamdash/shipped``.
"""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_INSIDE = _PACKAGE / "shipped"

ROOT = _INSIDE if _INSIDE.is_dir() else _PACKAGE.parent
"""Folder that holds ``app``, ``cache`` and ``docs``."""
APP = ROOT / "app"
CACHE = ROOT / "cache"
DOCS = ROOT / "docs"
