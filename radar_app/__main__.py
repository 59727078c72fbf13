"""`handwave`, and `python -m radar_app`."""

from __future__ import annotations

from radar_app.exits import finish


def main() -> None:
    """Run the command."""
    finish(_command)


def _command() -> None:
    from radar_app.cli import app  # takes a moment, in which Ctrl-C may come

    app(prog_name="handwave")


if __name__ == "__main__":
    main()
