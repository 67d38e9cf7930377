"""Entry point of the installed script and of `python3 -m ogm_mcmc`."""

import os
import signal
import sys
import threading
from typing import Any

__all__ = ['main']

AGAIN_S = 0.05


def main() -> None:
    """Run a command; quiet on Ctrl-C even while modules are imported or kernels compiled."""
    sys.unraisablehook = _stop_a_little_later
    try:
        from ogm_mcmc.cli.main import run

        code = run()
    except KeyboardInterrupt:
        code = 130
    sys.exit(code)


def _stop_a_little_later(unraisable: Any) -> None:
    """Send the signal again that came while C code was calling back, where it cannot be raised."""
    signals = {KeyboardInterrupt: signal.SIGINT, SystemExit: signal.SIGTERM}
    again = signals.get(unraisable.exc_type)
    if again is None:
        sys.__unraisablehook__(unraisable)
    else:
        threading.Timer(AGAIN_S, os.kill, (os.getpid(), again)).start()
