"""The parameter page and the parameter files, made from the config classes.

`python3 docs/parameter_pages.py docs` prints `docs/parameters.md`, `... NODE` prints
`config/NODE.yaml`; a test compares the files with this.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterable
from pathlib import Path

import yaml

# The pages are of the checkout that this file is in, not of an installed package.
sys.path.insert(0, str(Path(__file__).parent.parent))

from ogm_mcmc.config import Setting, settings_of
from ogm_mcmc.config.nodes import (
    LIVE_PARAMETERS,
    NODE_CONFIGS,
    REFINE_CONFIGS,
    REFINE_LIVE_PARAMETERS,
    ReplayConfig,
)

__all__ = ['NODES', 'page', 'parameter_file']

# Config classes and live parameters of the nodes that have a parameter file.
NODES = {
    'online_mapper': (NODE_CONFIGS, LIVE_PARAMETERS),
    'refine_server': (REFINE_CONFIGS, REFINE_LIVE_PARAMETERS),
}

INTRODUCTION = """\
# Parameters

Made by `python3 docs/parameter_pages.py docs` from the declarations in the code; a
test keeps it that way. Every wrong value is refused with the reason.

"Live" parameters take effect while the node runs; a change of any other is refused. On the
command line of `map`, `bench`, `demo` and `replay` the same names serve as options
(`max_range` is `--max-range`); the first three take the node's YAML with `--params-file`, and
refuse a name that the node does not know. Blocks for `/**`, `/robot1/**` or `/*/online_mapper`
count as ROS has it; of two that fit, the later one in the file wins.
"""


def _value(value: object) -> str:
    """Return a value as YAML writes it."""
    return yaml.safe_dump(value, default_flow_style=True).split('\n')[0]


def _range(leaf: Setting) -> str:
    if leaf.choices:
        return ', '.join(leaf.choices)
    if leaf.low is None or leaf.high is None:
        return ''
    return f'{leaf.low:g} to {leaf.high:g}'


def _table(leaves: Iterable[Setting], live: frozenset[str]) -> str:
    lines = ['| name | default | range | live | meaning |', '| --- | --- | --- | --- | --- |']
    for leaf in leaves:
        mark = 'yes' if leaf.name in live else ''
        lines.append(
            f'| `{leaf.name}` | `{_value(leaf.default)}` | {_range(leaf)} | {mark} '
            f'| {leaf.description} |'
        )
    return '\n'.join(lines)


def _leaves(node: str) -> list[Setting]:
    """Return the settings of a node; those of a group (`window.`) follow each other."""
    leaves = [leaf for config in NODES[node][0] for leaf in settings_of(config)]
    parents = [leaf.name.rpartition('.')[0] for leaf in leaves]
    places = [parents.index(parent) if parent else k for k, parent in enumerate(parents)]
    return [leaves[k] for k in sorted(range(len(leaves)), key=places.__getitem__)]


def page() -> str:
    """Return the text of `docs/parameters.md`."""
    tables = {node: _table(_leaves(node), live) for node, (_, live) in NODES.items()}
    tables['replay'] = _table(settings_of(ReplayConfig), frozenset())
    return INTRODUCTION + ''.join(f'\n## {node}\n\n{table}\n' for node, table in tables.items())


def parameter_file(node: str) -> str:
    """Return the text of `config/NODE.yaml`."""
    lines = [
        f'# Parameters of {node} with their defaults; made by',
        f'# `python3 docs/parameter_pages.py {node}`.',
        '/**:',
        '  ros__parameters:',
    ]
    group = ''
    for leaf in _leaves(node):
        parent, _, name = leaf.name.rpartition('.')
        indent = '      ' if parent else '    '
        if parent and parent != group:
            lines.append(f'    {parent}:')
        group = parent
        text = leaf.description + (f' ({_range(leaf)})' if _range(leaf) else '')
        lines += textwrap.wrap(
            text, 97, initial_indent=f'{indent}# ', subsequent_indent=f'{indent}# '
        )
        lines.append(f'{indent}{name}: {_value(leaf.default)}')
    return '\n'.join(lines) + '\n'


if __name__ == '__main__':
    print(page() if sys.argv[1:] == ['docs'] else parameter_file(sys.argv[1]), end='')
