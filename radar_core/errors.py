"""Errors that a user can act on."""

from __future__ import annotations

from collections.abc import Sequence


class HandwaveError(ValueError):
    """Something the user gave cannot be used.

    The message says what was wrong, where, and what to do. Commands print it without a traceback and exit with status 2; nodes log it
    once.
    """


class ConfigError(HandwaveError):
    """A configuration value, parameter or scene file that does not make sense.

    ``key`` is the place of the value within what was checked, so that the message of a file can name its line.
    """

    def __init__(self, message: str, key: Sequence[str | int] = ()) -> None:
        super().__init__(message)
        self.key = tuple(key)


class DataError(HandwaveError):
    """Measured or recorded data that contradicts itself or its description."""


class DeviceError(HandwaveError):
    """A device that is not there, does not answer, or answers what it should not.

    ``gone`` says that it has to be opened anew before anything else can work: it was unplugged, or its link is in an unknown state.
    """

    def __init__(self, message: str, *, gone: bool = False) -> None:
        super().__init__(message)
        self.gone = gone
