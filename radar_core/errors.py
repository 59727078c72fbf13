"""Errors that a user can act on."""

from __future__ import annotations


class HandwaveError(ValueError):
    """Something the user gave cannot be used.

    The message says what was wrong, where, and what to do. Commands print it without a traceback and exit with status 2; nodes log it
    once.
    """


class ConfigError(HandwaveError):
    """A configuration value, parameter or scene file that does not make sense."""


class DataError(HandwaveError):
    """Measured or recorded data that contradicts itself or its description."""
