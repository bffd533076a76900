"""The limit of uploads is the server's: no message from a browser raises it."""

from __future__ import annotations

import base64

from app.ui.upload import FileDrop


def send(drop: FileDrop, size: int) -> None:
    drop._handle_msg({"data": base64.b64encode(bytes(size)).decode()})


def test_a_browser_that_raises_the_limit_uploads_no_more():
    received, refused = [], []
    drop = FileDrop(received.append, refused.append, limit=300)
    drop._process_events({"limit": 10_000_000, "too_large": "anything"})
    assert drop.limit == 10_000_000  # what the browser has is the browser's
    send(drop, 100_000)
    assert not received and "larger than 0.0003 MB" in refused[0]
    send(drop, 300)
    assert len(received[0]) == 300
