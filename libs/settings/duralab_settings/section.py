"""Base class of all groups of settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from duralab_settings.values import SettingsError
from duralab_settings.wording import explained


class Section(BaseModel):
    """Group of settings: only known keys with values of their type are accepted.

    Raises
    ------
    SettingsError
        If a key or value is not allowed.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    if not TYPE_CHECKING:

        def __init__(self, /, **values: Any) -> None:
            """Check the values from a script."""
            try:
                super().__init__(**values)
            except ValidationError as error:
                raise explained(error, type(self)) from error

        # Nested sections are still checked as one, so that an error names the whole path.
        __init__.__pydantic_base_init__ = True

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, which are not checked; raise SettingsError for an unknown key."""
        if unknown := [key for key in update or {} if key not in type(self).model_fields]:
            allowed = ", ".join(type(self).model_fields)
            raise SettingsError(f"unknown key {unknown[0]!r}; allowed: {allowed}.", field=unknown[0])
        return super().model_copy(update=update, deep=deep)
