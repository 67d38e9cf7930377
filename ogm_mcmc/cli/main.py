"""Parse the command line and run one command."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

from ogm_mcmc import __version__
from ogm_mcmc.cli.options import drop_output, path_argument
from ogm_mcmc.errors import OgmError
from ogm_mcmc.files.saying import say
from ogm_mcmc.files.signals import leave_on_signals

__all__ = ['run']

# Commands and their modules; only that of the command in use is imported.
COMMANDS = {
    'map': 'map_bag',
    'sample': 'sample',
    'learn-prior': 'learn_prior',
    'import-carmen': 'import_carmen',
    'import-stata': 'import_stata',
    'simulate': 'simulate',
    'evaluate': 'evaluate',
    'experiment': 'experiment',
    'info': 'info',
    'replay': 'replay',
    'call': 'call',
    'bench': 'bench',
    'warm-up': 'warm_up',
    'demo': 'demo',
}


class _Parser(argparse.ArgumentParser):
    """A parser, as its commands have them too, whose paths are read by `path_argument`."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.register('type', Path, path_argument)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line: options of some commands fill a screen."""
        self.exit(2, f'{self.prog}: error: {message} (options: {self.prog} -h)\n')


def make_parser(commands: Iterable[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser with all commands, or with some."""
    parser = _Parser(
        prog='ogm_mcmc', description='Occupancy grid maps with probabilities to believe.'
    )
    parser.add_argument('--version', action='version', version=__version__)
    subparsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for command in commands:
        importlib.import_module(f'ogm_mcmc.cli.{COMMANDS[command]}').add_to(subparsers)
    return parser


def run(argv: list[str] | None = None) -> int:
    """Run a command; return the exit code."""
    argv = sys.argv[1:] if argv is None else argv
    named = [word for word in argv[:1] if word in COMMANDS]
    parser = make_parser(named or COMMANDS)
    options, unknown = parser.parse_known_args(argv)
    if unknown:
        parser.prog += f' {options.command}'  # whose help tells what it takes
        parser.error(f'unrecognized arguments: {" ".join(unknown)}')
    leave_on_signals()
    try:
        return int(options.run(options))
    except OgmError as error:
        say(f'ogm_mcmc {options.command}: error: {error}')
        return 2
    except MemoryError as error:
        what = str(error) or 'more memory was asked for than there is'
        say(f'ogm_mcmc {options.command}: error: out of memory ({what}): expected a coarser or '
            'smaller map, fewer beams, or a machine with more')  # fmt: skip
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        drop_output()  # whoever read it has gone
        return 1
