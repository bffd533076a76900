"""How the server is exposed: settings from the environment, and the combinations it refuses."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path

from pydantic import Field, SecretStr, field_validator

from streamdash.cli.common import InputError
from streamdash.settings import Settings

SECRET_LENGTH = 32
PASSWORD_LENGTH = 10
OAUTH = ("KEY", "SECRET", "REDIRECT_URI", "ENCRYPTION")
"""What Panel's OAuth needs beside the provider, as ``PANEL_OAUTH_…`` variables."""


class Deployment(Settings):
    """Where the server listens and whom it lets in; the defaults are for one person on one machine."""

    address: str = Field("localhost", description="address to listen on; 0.0.0.0 is all of this machine's")
    port: int = Field(5006, ge=1, le=65535, description="port to listen on")
    origins: tuple[str, ...] = Field(
        (), description="where browsers reach the server, HOST[:PORT], several with commas between"
    )
    prefix: str = Field("", description="path under which a proxy shows the dashboard, as /streams")
    behind_proxy: bool = Field(
        False,
        description="believe a proxy's X-Forwarded headers; only where all visitors come through it",
    )
    tls_certificate: Path | None = Field(None, description="certificate file (PEM) to serve https with")
    tls_key: Path | None = Field(None, description="its private key file (PEM)")
    embedded_in: tuple[str, ...] = Field(
        (),
        description="websites that may show the dashboard in a frame, https://HOST, several with commas "
        "between",
    )
    secret: SecretStr = Field(
        SecretStr(""),
        description=f"signs sessions and cookies, {SECRET_LENGTH} characters or more; a new one at every "
        "start when not given, so give it where several processes serve one address",
    )
    password: SecretStr = Field(
        SecretStr(""), description=f"one password for all visitors, {PASSWORD_LENGTH} characters or more"
    )

    @field_validator("origins", "embedded_in", mode="before")
    @classmethod
    def _split(cls, value):
        if not isinstance(value, str):
            return value
        return tuple(part.strip() for part in value.split(",") if part.strip())

    @field_validator("origins")
    @classmethod
    def _hosts(cls, value):
        for origin in value:
            if "/" in origin or " " in origin:
                raise ValueError(f"{origin} must be HOST or HOST:PORT, without https:// and path")
        return value

    @field_validator("embedded_in")
    @classmethod
    def _websites(cls, value):
        for site in value:
            if not re.fullmatch(r"https?://[A-Za-z0-9.*-]+(:\d{1,5})?", site):
                raise ValueError(f"{site} must be a website, as https://course.example.org")
        return value

    @field_validator("prefix")
    @classmethod
    def _path(cls, value):
        if value and not (value.startswith("/") and value.strip("/").replace("/", "").isalnum()):
            raise ValueError("must be a path of letters and digits, as /streams")
        return value.rstrip("/")

    @property
    def is_public(self) -> bool:
        """Whether other machines can reach the port."""
        if self.address == "localhost":
            return False
        try:
            return not ipaddress.ip_address(self.address).is_loopback
        except ValueError:  # a name, or empty: all addresses
            return True


def check(settings: Deployment, environment: Mapping[str, str]) -> None:
    """Refuse what would expose visitors or the server.

    Parameters
    ----------
    settings : Deployment
    environment : mapping
        For Panel's and Bokeh's own variables.

    Raises
    ------
    InputError
        Naming the variables, why, and what to do.
    """
    for sentence in _faults(settings, environment):
        raise InputError(sentence)


def _faults(settings: Deployment, environment: Mapping[str, str]) -> Iterator[str]:
    password = settings.password.get_secret_value()
    provider = environment.get("PANEL_OAUTH_PROVIDER", "")
    if password and len(password) < PASSWORD_LENGTH:
        yield f"STREAMDASH_PASSWORD is shorter than {PASSWORD_LENGTH} characters; choose a longer one."
    if 0 < len(settings.secret.get_secret_value()) < SECRET_LENGTH:
        yield (
            f"STREAMDASH_SECRET is shorter than {SECRET_LENGTH} characters; make one with "
            "`python -c 'import secrets; print(secrets.token_hex(32))'`."
        )
    if environment.get("PANEL_BASIC_AUTH"):
        yield (
            "PANEL_BASIC_AUTH is set, which this version of Panel turns to lower case: use "
            "STREAMDASH_PASSWORD instead."
        )
    if environment.get("BOKEH_SIGN_SESSIONS", "").lower() in ("no", "false", "0", "off"):
        yield "BOKEH_SIGN_SESSIONS turns signed sessions off; unset it: the server signs them always."
    if "*" in settings.origins and (settings.is_public or settings.behind_proxy or password or provider):
        yield (
            "STREAMDASH_ORIGINS=* lets every website open sessions in its visitors' names; name the "
            "hosts under which the dashboard is reached."
        )
    if password and provider:
        yield "STREAMDASH_PASSWORD and PANEL_OAUTH_PROVIDER are both set; keep one of them."
    missing = [f"PANEL_OAUTH_{name}" for name in OAUTH if not environment.get(f"PANEL_OAUTH_{name}")]
    if provider and missing:
        yield f"PANEL_OAUTH_PROVIDER needs {', '.join(missing)} as well."
    if (settings.tls_certificate is None) != (settings.tls_key is None):
        yield "STREAMDASH_TLS_CERTIFICATE and STREAMDASH_TLS_KEY only work together; set both or none."
    for name in ("tls_certificate", "tls_key"):
        path = getattr(settings, name)
        if path is not None and not path.is_file():
            yield f"{Deployment.variable(name)}: there is no file {path}."
    if (password or provider) and settings.is_public and not (settings.tls_key or settings.behind_proxy):
        yield (
            "Passwords would cross the network unencrypted: set STREAMDASH_TLS_CERTIFICATE and "
            "STREAMDASH_TLS_KEY, or serve behind a proxy that does https and set STREAMDASH_BEHIND_PROXY=1."
        )


def warnings_of(settings: Deployment, environment: Mapping[str, str]) -> list[str]:
    """What is allowed and should be known, one sentence each.

    Parameters
    ----------
    settings : Deployment
    environment : mapping
        For Panel's own variables.
    """
    guarded = settings.password.get_secret_value() or environment.get("PANEL_OAUTH_PROVIDER")
    if guarded or not settings.is_public:
        return []
    return [
        f"Everyone who reaches port {settings.port} of this machine can use the dashboard and start "
        "simulations: it listens beyond this machine and STREAMDASH_PASSWORD is not set."
    ]


def server_environment(settings: Deployment, environment: Mapping[str, str]) -> dict[str, str]:
    """`environment` with what Bokeh and Panel read their secrets from; sessions are always signed."""
    secret = (
        settings.secret.get_secret_value() or environment.get("BOKEH_SECRET_KEY") or secrets.token_hex(32)
    )
    cookies = hmac.new(secret.encode(), b"cookies", hashlib.sha256).hexdigest()
    password = settings.password.get_secret_value()
    return {
        **environment,
        "BOKEH_SIGN_SESSIONS": "yes",
        "BOKEH_SECRET_KEY": secret,
        "PANEL_COOKIE_SECRET": environment.get("PANEL_COOKIE_SECRET") or cookies,
        Deployment.variable("embedded_in"): ",".join(settings.embedded_in),
        **({Deployment.variable("password"): password} if password else {}),
    }


def server_arguments(settings: Deployment, show: bool, environment: Mapping[str, str]) -> list[str]:
    """Options of ``panel serve``.

    Browsers are let in from localhost and the bound address, unless the settings or
    ``BOKEH_ALLOW_WS_ORIGIN`` say otherwise. Health checks belong on ``/liveness``: a look at
    ``/`` would build a session.
    """
    arguments = ["--port", str(settings.port), "--address", settings.address, "--liveness"]
    origins = list(settings.origins)
    if not origins and not environment.get("BOKEH_ALLOW_WS_ORIGIN"):
        hosts = ["localhost", "127.0.0.1"]
        if settings.address not in ("", "0.0.0.0", "::", *hosts):  # noqa: S104 (compared, not bound)
            hosts.append(settings.address)
        origins = [f"{host}:{settings.port}" for host in hosts]
    for origin in origins:
        arguments += ["--allow-websocket-origin", origin]
    if settings.prefix:
        arguments += ["--prefix", settings.prefix]
    if settings.behind_proxy:
        arguments.append("--use-xheaders")
    if settings.tls_certificate and settings.tls_key:
        arguments += ["--ssl-certfile", str(settings.tls_certificate), "--ssl-keyfile", str(settings.tls_key)]
    return [*arguments, "--show"] if show else arguments


def settings_table(settings: Settings) -> list[tuple[str, str, str]]:
    """Variable, value now and meaning of each setting; secrets are not shown."""
    rows = []
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        if isinstance(value, SecretStr):
            shown = "set" if value.get_secret_value() else "not set"
        else:
            shown = ", ".join(value) if isinstance(value, tuple) else str(value or "")
        rows.append((settings.variable(name), shown, field.description or ""))
    return rows
