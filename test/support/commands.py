"""Commands run in the test's own process."""

from __future__ import annotations

from typing import Any

from ogm_mcmc.cli.main import run

__all__ = ['command']


def command(capsys: Any, *arguments: object) -> tuple[int, str, str]:
    """Run a command; return the exit code and what was printed, `capsys` being pytest's."""
    try:
        code = run([str(argument) for argument in arguments])
    except SystemExit as stopped:  # argparse's own
        code = int(stopped.code or 0)
    printed = capsys.readouterr()
    return code, printed.out, printed.err
