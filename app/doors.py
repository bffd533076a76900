"""What stands between the network and the dashboard: headers of every answer, passwords, cookies.

`Serve` is Panel's own command with its public hook ``customize_kwargs``: it hands Tornado a
transform for all answers and, where there is a password, a sign-in that slows guessing down.
"""

from __future__ import annotations

import hmac
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from cachetools import TTLCache
from panel.auth import BasicAuthProvider, BasicLoginHandler
from panel.command.serve import Serve as PanelServe
from panel.config import config
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform

from app.borrowed import sign_in_pages
from app.session.visitor import network

FREE_GUESSES = 5
"""Wrong passwords of one address before it has to wait."""
LONGEST_LOCK_S = 300.0
FORGET_S = 3600.0
"""After an hour without a guess an address begins anew."""
ADDRESSES = 4096
"""Addresses that are remembered at the same time; those that guessed longest ago go first."""


class Guesses:
    """Wrong passwords by address: after `FREE_GUESSES` each one doubles the time until the next.

    Parameters
    ----------
    clock : callable
        Seconds that only rise.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._wrong: TTLCache[str, tuple[int, float]] = TTLCache(ADDRESSES, FORGET_S, clock)

    def wait(self, address: str) -> float:
        """Seconds until this address may try again; 0 when it may now."""
        _, until = self._wrong.get(network(address), (0, 0.0))
        return max(0.0, until - self._clock())

    def wrong(self, address: str) -> None:
        """Note a wrong password."""
        place = network(address)
        count = self._wrong.pop(place, (0, 0.0))[0] + 1
        lock = min(2.0 ** min(count - FREE_GUESSES, 30), LONGEST_LOCK_S) if count >= FREE_GUESSES else 0.0
        self._wrong[place] = (count, self._clock() + lock)

    def right(self, address: str) -> None:
        """Forget what went wrong before."""
        self._wrong.pop(network(address), None)

    def __len__(self) -> int:
        return len(self._wrong)


class Login(BasicLoginHandler):
    """Panel's sign-in, which refuses to look at passwords of an address that has guessed too often."""

    guesses = Guesses()

    def set_cookie(self, name: str, value: Any, *args: Any, **choices: Any) -> None:
        """A cookie that other websites' forms do not bring along, nor unencrypted connections."""
        choices = {"samesite": "Lax", "secure": self.request.protocol == "https", **choices}
        super().set_cookie(name, value, *args, **choices)

    def post(self) -> None:
        """Let in who gives the password, unless this address has to wait."""
        address = self.request.remote_ip or ""
        wait = self.guesses.wait(address)
        if wait > 0:
            self.set_status(429)
            self.set_header("Retry-After", str(math.ceil(wait)))
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(f"Too many wrong passwords; try again in {math.ceil(wait)} seconds.\n")
            return
        super().post()

    def _validate(self, username: str, password: str) -> bool:
        """Whether the password is right, in a time that does not tell how much of it is."""
        expected = str(config.basic_auth)
        right = hmac.compare_digest(password.encode(), expected.encode())
        address = self.request.remote_ip or ""
        (self.guesses.right if right else self.guesses.wrong)(address)
        return right


class PasswordProvider(BasicAuthProvider):
    """Panel's one password for all, with `Login` before it."""

    @property
    def login_handler(self) -> type[Login]:
        """Handler of ``/login``."""
        for name, value in sign_in_pages(self).items():
            setattr(Login, name, value)
        return Login


def headers(embedded_in: Sequence[str] = ()) -> dict[str, str]:
    """Headers of every answer.

    Parameters
    ----------
    embedded_in
        Websites that may show the dashboard in a frame, beside this one.

    Notes
    -----
    The policy is as strict as Bokeh 3.9 and Panel 1.9 permit. They need scripts and styles inside the
    page (their templates start the documents so), ``eval`` (Bokeh's ``CustomJS`` and templates), modules
    from ``blob:`` (Panel's components) and images and fonts from ``data:``. Nothing may be fetched from,
    sent to or loaded from anywhere but this server.
    """
    policy = {
        "default-src": "'self'",
        "script-src": "'self' 'unsafe-inline' 'unsafe-eval' blob:",
        "style-src": "'self' 'unsafe-inline'",
        "img-src": "'self' data: blob:",
        "font-src": "'self' data:",
        "connect-src": "'self' data: blob:",
        "worker-src": "'self' blob:",
        "object-src": "'none'",
        "base-uri": "'self'",
        "form-action": "'self'",
        "frame-ancestors": " ".join(["'self'", *embedded_in]),
    }
    return {
        "Content-Security-Policy": "; ".join(f"{name} {value}" for name, value in policy.items()),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
    }


def transform(embedded_in: Sequence[str] = ()) -> type[OutputTransform]:
    """Tornado's transform that gives every answer its `headers` and keeps the server's version back."""
    added = headers(embedded_in)

    class Guarded(OutputTransform):
        def __init__(self, request: HTTPServerRequest) -> None:
            pass

        def transform_first_chunk(
            self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
        ) -> tuple[int, HTTPHeaders, bytes]:
            headers.pop("Server", None)
            for name, value in added.items():
                headers[name] = value
            return status_code, headers, chunk

    return Guarded


class Serve(PanelServe):
    """``panel serve`` with guarded doors."""

    embedded_in: Sequence[str] = ()

    def customize_kwargs(self, args: Any, server_kwargs: dict[str, Any]) -> dict[str, Any]:
        """What Panel gives its server, with our transform and sign-in."""
        kwargs = super().customize_kwargs(args, server_kwargs)
        kwargs["transforms"] = [transform(self.embedded_in)]
        if type(kwargs.get("auth_provider")) is BasicAuthProvider:
            kwargs["auth_provider"] = PasswordProvider()
        return kwargs
