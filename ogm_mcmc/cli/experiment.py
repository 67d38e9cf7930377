"""`experiment NAME`: a published table or figure, our numbers beside the paper's."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from ogm_mcmc import __version__
from ogm_mcmc.cli.options import (
    Subparsers,
    add_json,
    add_scheduler,
    print_result,
    require_matplotlib,
)
from ogm_mcmc.errors import ConfigError, require
from ogm_mcmc.files.output_files import folder_to_fill, refuse_folder, replacing_set
from ogm_mcmc.files.saying import say
from ogm_mcmc.lab.experiments import EXPERIMENTS, SPREAD, make_page
from ogm_mcmc.lab.experiments.datasets import using_executor
from ogm_mcmc.lab.experiments.results import table_text
from ogm_mcmc.lab.workers import connected

__all__ = ['add_to']


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        'experiment',
        help="reproduce a paper's table or figure",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=_subjects(),
    )
    parser.add_argument('name', choices=sorted(EXPERIMENTS), help='which one')
    parser.add_argument('--quick', action='store_true', help="minutes instead of the paper's size")
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument(
        '-o', dest='folder', type=Path, metavar='DIR', help='default: out/experiments/NAME'
    )
    add_scheduler(parser, f'; for {", ".join(SPREAD)}')
    add_json(parser)
    parser.set_defaults(run=run)


def _subjects() -> str:
    """Say of each experiment what it is about: the first line of its module."""
    lines = ['what they are about (papers by their keys, see the README):']
    for name, function in sorted(EXPERIMENTS.items()):
        about = (sys.modules[function.__module__].__doc__ or '').partition('\n')[0]
        lines.append(f'  {name:26}{about}')
    return '\n'.join(lines)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    require(options.seed >= 0, 'seed', options.seed, 'expected 0 or more')
    if options.scheduler and options.name not in SPREAD:
        raise ConfigError(
            f'--scheduler: {options.name} has nothing to spread; expected one of '
            f'{", ".join(SPREAD)}'
        )
    require_matplotlib()
    # Where something is missing, no empty folder is left.
    with folder_to_fill(options.folder or Path('out/experiments') / options.name) as folder:
        return _run_into(folder, options)


def _run_into(folder: Path, options: argparse.Namespace) -> int:
    paths = {
        kind: folder / name for kind, name in (('json', 'result.json'), ('html', 'index.html'))
    }
    for path in paths.values():
        refuse_folder(path)
    started = time.perf_counter()
    with connected(options.scheduler) as executor, using_executor(executor):
        try:
            found = EXPERIMENTS[options.name](folder, quick=options.quick, seed=options.seed)
        except KeyboardInterrupt:
            if any((folder / 'datasets').glob('*.json')):
                say(f'what is finished is kept in {folder}: the same command goes on from there')
            raise
    result: dict[str, Any] = {
        'name': options.name,
        'quick': options.quick,
        'seed': options.seed,
        'version': __version__,
        'seconds': round(time.perf_counter() - started, 2),
        **found,
    }
    page = make_page(folder, result)
    with replacing_set(folder, 'index') as scratch:
        told = json.dumps(result, indent=2) + '\n'
        (scratch / paths['json'].name).write_text(told, encoding='utf-8')
        (scratch / paths['html'].name).write_text(page.html(), encoding='utf-8')
    print_result(options, result, f'{table_text(result)}\n{paths["html"]}')
    return 0
