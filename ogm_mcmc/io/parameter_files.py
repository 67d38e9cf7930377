"""ROS parameter files, as commands read them; nodes leave that to rclpy."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.yaml_files import read_yaml

__all__ = ['read_parameter_file']

# Stands for a namespace that a `*` leaves open.
ANY = 'any'

WILD = {'*': r'/\w+', '**': r'(/\w+)*'}


def read_parameter_file(path: Path, node: str = 'online_mapper') -> dict[str, Any]:
    """Dotted parameters a ROS parameter file holds for a node, or those of a plain YAML mapping.

    As ROS does: in the name of a block `*` stands for one name and `**` for any number of them;
    of the blocks that fit a node in its namespace a later one comes after those before it. A
    command is in no namespace: it takes the one of the block that names the node, or else one
    that all blocks have which do not fit everywhere. Raises ConfigError when the file is missing
    or not such a mapping, when nothing in it is for this node, and when there are nodes of this
    name in several namespaces.
    """
    content = read_yaml(path, 'YAML parameter file', ConfigError)
    if not isinstance(content, dict):
        raise ConfigError(f'{path}: expected a mapping of parameter names to values')
    blocks = list(_node_blocks(content, ''))
    if not blocks:
        return _dotted(content, '')
    names = _names_fitting([name for name, _ in blocks], node, path)
    values: dict[str, Any] = {}
    for name, held in blocks:
        if name in names:
            if not isinstance(held, dict):
                raise ConfigError(f'{path}: {name}: expected a mapping of names to values')
            values.update(_dotted(held, ''))
    return values


def _names_fitting(names: list[str], node: str, path: Path) -> set[str]:
    """Return those names of blocks that fit the node in one namespace. Raises ConfigError."""
    fitting = {name: full for name in names if (full := _full_name(name, node))}
    if not fitting:
        raise ConfigError(
            f'{path}: nothing for {node} in it, only {", ".join(names)}: '
            f'expected a block {node} or /**'
        )
    own = {name: full for name, full in fitting.items() if '*' not in name}
    anywhere = f'/{node}', f'/{ANY}/{ANY}/{node}'
    somewhere = {
        name: full
        for name, full in fitting.items()
        if not all(_fits(name, one) for one in anywhere)
    }
    chosen = own or somewhere or fitting
    at = [full for full in chosen.values() if all(_fits(name, full) for name in chosen)]
    if not at:
        raise ConfigError(f'{path}: {" and ".join(chosen)}: expected one block for {node}')
    return {name for name in fitting if _fits(name, at[0])}


def _full_name(name: str, node: str) -> str:
    """Return a node of this name, with its namespace, that a block is for; empty: of none."""
    *space, last = name.strip('/').split('/')
    if last not in ('*', '**', node):
        return ''
    there = [ANY if one == '*' else one for one in space if one != '**']
    return '/'.join(['', *there, node])


def _fits(name: str, full_name: str) -> bool:
    """Whether a block is for a node, as rcl and rclpy decide it."""
    pattern = ''.join(
        WILD.get(token, '/' + re.escape(token)) for token in name.strip('/').split('/')
    )
    return re.fullmatch(pattern, full_name) is not None


def _node_blocks(tree: Mapping[Any, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the full names of nodes, and what each block holds under `ros__parameters`."""
    for key, block in tree.items():
        if not isinstance(block, dict):
            continue
        if 'ros__parameters' in block:
            yield f'{prefix}{key}', block['ros__parameters']
        else:
            yield from _node_blocks(block, f'{prefix}{key}/')


def _dotted(tree: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat.update(_dotted(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat
