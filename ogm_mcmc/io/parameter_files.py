"""ROS parameter files, as commands read them; nodes leave that to rclpy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.yaml_files import read_yaml

__all__ = ['read_parameter_file']


def read_parameter_file(path: Path, node: str = 'online_mapper') -> dict[str, Any]:
    """Dotted parameters a ROS parameter file holds for a node, or those of a plain YAML mapping.

    As ROS does: `/**` for all nodes, then the node's own, whose namespace may come before its
    name or around it. A command is in no namespace: it takes the block of whichever one is there.
    Raises ConfigError when the file is missing or not such a mapping, when nothing in it is for
    this node, and when there are nodes of this name in several namespaces.
    """
    content = read_yaml(path, 'YAML parameter file', ConfigError)
    if not isinstance(content, dict):
        raise ConfigError(f'{path}: expected a mapping of parameter names to values')
    blocks = dict(_node_blocks(content, ''))
    if not blocks:
        return _dotted(content, '')
    for_all = [name for name in blocks if name.strip('/') == '**']
    anywhere = [name for name in blocks if name.strip('/') == f'**/{node}']
    own = [name for name in blocks if name.rpartition('/')[2] == node and name not in anywhere]
    if len({name.strip('/') for name in own}) > 1:
        raise ConfigError(f'{path}: {" and ".join(own)}: expected one block for {node}')
    if not for_all + anywhere + own:
        raise ConfigError(
            f'{path}: nothing for {node} in it, only {", ".join(blocks)}: '
            f'expected a block {node} or /**'
        )
    values: dict[str, Any] = {}
    for name in for_all + anywhere + own:
        held = blocks[name]
        if not isinstance(held, dict):
            raise ConfigError(f'{path}: {name}: expected a mapping of names to values')
        values.update(_dotted(held, ''))
    return values


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
