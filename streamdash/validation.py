"""Frozen, validated, hashable models: what every configuration is made of."""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

Finite = Annotated[float, Field(allow_inf_nan=False)]
CHOICE = "as:"
"""Start of the tags of discriminated unions; complaints leave such parts of a field's name out."""


class ConfigError(ValueError):
    """A configuration that cannot be used; the message names the field and the fix."""


class Config(BaseModel):
    """Base of all configurations: frozen, no unknown fields, hashed by content."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise ConfigError(_sentence(error)) from None

    @property
    def key(self) -> str:
        """Content hash: 16 hexadecimal digits that depend on every field's value."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @classmethod
    def parse(cls, data: Any) -> Self:
        """Read a configuration from JSON text or a mapping.

        Raises
        ------
        ConfigError
            In one sentence: which field is wrong and what is allowed.
        """
        try:
            if isinstance(data, (str, bytes)):
                return cls.model_validate_json(data)
            return cls.model_validate(data)
        except ValidationError as error:
            raise ConfigError(_sentence(error)) from None


PLAIN = {
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "int_type": "must be a whole number",
    "float_parsing": "must be a number",
    "float_type": "must be a number",
    "bool_parsing": "must be yes or no",
    "bool_type": "must be yes or no",
}
"""What pydantic says in a programmer's words, by its type of error."""


def _sentence(error: ValidationError) -> str:
    """One sentence a person can act on, from pydantic's first complaint."""
    first = error.errors(include_url=False)[0]
    # an unknown field's name is whatever was typed: keep it to one line
    parts = [str(part) for part in first["loc"] if not str(part).startswith(CHOICE)]
    field = ".".join(part if part.isprintable() else repr(part) for part in parts)
    inner = first.get("ctx", {}).get("error")
    if isinstance(inner, ConfigError):  # a model inside this one has said it already
        return f"{field}.{inner}" if field else str(inner)
    field = field or "configuration"
    message = PLAIN.get(first["type"], first["msg"].removeprefix("Value error, "))
    value = repr(first.get("input"))
    given = first.get("input")
    models = isinstance(given, tuple) and any(isinstance(item, Config) for item in given)
    told = first["loc"] and not models  # nobody typed those
    shown = f" (got {value if len(value) <= 60 else value[:57] + '...'})" if told else ""
    return f"{field}: {message[0].lower() + message[1:]}{shown}."
