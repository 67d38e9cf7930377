"""Entry point of the installed script and of `python3 -m ogm_mcmc`."""

import sys

from ogm_mcmc.engine.signals import leave_on_signals, stop_a_little_later

__all__ = ['main']


def main() -> None:
    """Run a command; quiet on Ctrl-C even while modules are imported or kernels compiled."""
    sys.unraisablehook = stop_a_little_later
    try:
        leave_on_signals()
        from ogm_mcmc.cli.main import run

        code = run()
    except KeyboardInterrupt:
        code = 130
    sys.exit(code)
