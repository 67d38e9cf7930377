"""Entry point of the installed script and of `python3 -m ogm_mcmc`."""

import os
import sys

from ogm_mcmc.files.signals import (
    end_at_once_on_signals,
    leave_on_signals,
    stop_a_little_later,
)

__all__ = ['main']


def main() -> None:
    """Run a command; quiet on Ctrl-C also while it imports modules, compiles kernels or exits."""
    sys.unraisablehook = stop_a_little_later
    try:
        _open_closed_streams()
        leave_on_signals()
        from ogm_mcmc.cli.main import run

        code = run()
        end_at_once_on_signals(code)  # in here, so that one that came just before is answered
    except KeyboardInterrupt:
        code = 130
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
        end_at_once_on_signals(code)
        raise
    except Exception as error:
        found = _left_by(error)
        if found is None:
            raise
        code = found
    end_at_once_on_signals(code)
    sys.exit(code)


def _left_by(error: BaseException | None) -> int | None:
    """Return the exit code of a signal that became another error; None of an error by itself.

    While a class is made Python 3.11 tells what is raised as a RuntimeError of that cause.
    """
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return 130
        if isinstance(error, SystemExit):
            return 143
        error = error.__cause__
    return None


def _open_closed_streams() -> None:
    """Where a standard stream was closed, let nothing come in and all that is said be lost.

    Or the next file opened would take its number, and hold what is meant for the stream.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the least number that is free
    sys.stdout = sys.stdout or os.fdopen(1, 'w', encoding='utf-8', closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, 'w', encoding='utf-8', closefd=False)
