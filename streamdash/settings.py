"""Settings that an operator gives as environment variables."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Self

from streamdash.config import Config, ConfigError

PREFIX = "STREAMDASH_"


class Settings(Config):
    """Base of what is set by environment variables: ``STREAMDASH_`` and a field's name in capitals."""

    @classmethod
    def variable(cls, name: str) -> str:
        """Environment variable of field `name`."""
        return PREFIX + name.upper()

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ, **given: object) -> Self:
        """Settings as the variables say; a variable that is empty or missing leaves the default.

        Parameters
        ----------
        environment : mapping, optional
        **given
            Fields that were given otherwise, on the command line for example; None is not given.

        Raises
        ------
        ConfigError
            In one sentence that names the variable.
        """
        found = {name: environment.get(cls.variable(name), "").strip() for name in cls.model_fields}
        values = {name: text for name, text in found.items() if text}
        try:
            return cls(**values | {name: value for name, value in given.items() if value is not None})
        except ConfigError as error:
            name, colon, rest = str(error).partition(":")
            if colon and name in cls.model_fields:
                raise ConfigError(f"{cls.variable(name)}:{rest}") from None
            raise
