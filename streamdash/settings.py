"""Settings that an operator gives as environment variables."""

from __future__ import annotations

from typing import Any

from pydantic_settings import BaseSettings, SettingsConfigDict

from streamdash.config import Config, ConfigError

PREFIX = "STREAMDASH_"


class Settings(Config, BaseSettings):
    """Base of what is set by environment variables: ``STREAMDASH_`` and a field's name in capitals.

    A variable that is empty or missing leaves the default; what is given by name, on the command line for
    example, wins.

    Raises
    ------
    ConfigError
        In one sentence that names the variable.
    """

    model_config = SettingsConfigDict(
        env_prefix=PREFIX,
        env_ignore_empty=True,
        enable_decoding=False,  # lists are written with commas, not as JSON
        str_strip_whitespace=True,
    )

    def __init__(self, **given: Any) -> None:
        try:
            super().__init__(**given)
        except ConfigError as error:
            name, colon, rest = str(error).partition(":")
            if colon and name in type(self).model_fields:
                raise ConfigError(f"{self.variable(name)}:{rest}") from None
            raise

    @classmethod
    def variable(cls, name: str) -> str:
        """Environment variable of field `name`."""
        return PREFIX + name.upper()
