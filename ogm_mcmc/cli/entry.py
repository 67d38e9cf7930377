"""Entry point of the installed script and of `python3 -m ogm_mcmc`."""

import sys

__all__ = ['main']


def main() -> None:
    """Run a command; quiet on Ctrl-C even while modules are still being imported."""
    try:
        from ogm_mcmc.cli.main import run

        code = run()
    except KeyboardInterrupt:
        code = 130
    sys.exit(code)
