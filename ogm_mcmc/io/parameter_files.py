"""ROS parameter files, as commands read them; nodes leave that to rclpy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeGuard

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.yaml_files import read_yaml

__all__ = ['read_parameter_file']


def read_parameter_file(path: Path, node: str = 'online_mapper') -> dict[str, Any]:
    """Dotted parameters a ROS parameter file holds for a node, or those of a plain YAML mapping.

    As ROS does: `/**` for all nodes, then the node's own. Raises ConfigError when the file is
    missing or not such a mapping.
    """
    content = read_yaml(path, 'YAML parameter file', ConfigError)
    if not isinstance(content, dict):
        raise ConfigError(f'{path}: expected a mapping of parameter names to values')
    if not any(_is_node_block(block) for block in content.values()):
        return _dotted(content, '')
    values: dict[str, Any] = {}
    for name in ('/**', node, f'/{node}', f'/**/{node}'):
        block = content.get(name)
        if _is_node_block(block):
            held = block['ros__parameters']
            if not isinstance(held, dict):
                raise ConfigError(f'{path}: {name}: expected a mapping of names to values')
            values.update(_dotted(held, ''))
    return values


def _is_node_block(block: Any) -> TypeGuard[dict[str, Any]]:
    return isinstance(block, dict) and 'ros__parameters' in block


def _dotted(tree: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat.update(_dotted(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat
