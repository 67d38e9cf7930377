"""Commands run in the test's own process."""

from __future__ import annotations

import contextlib
import io
import subprocess
from typing import Any

from ogm_mcmc.cli.main import run

__all__ = ['command', 'finished']


def command(capsys: Any, *arguments: object) -> tuple[int, str, str]:
    """Run a command; return the exit code and what was printed, `capsys` being pytest's."""
    try:
        code = run([str(argument) for argument in arguments])
    except SystemExit as stopped:  # argparse's own
        code = int(stopped.code or 0)
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def finished(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command; return what a process of its own would have left behind."""
    words = [str(argument) for argument in arguments]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = run(words)
        except SystemExit as stopped:  # argparse's own
            code = int(stopped.code or 0)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())
