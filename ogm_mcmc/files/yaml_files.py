"""YAML that is settings: of a bounded size, without anchors, and nested a few levels only.

With anchors and aliases a few lines stand for gigabytes ("billion laughs"); deep nesting ends
Python's stack; a number of a million digits takes minutes to read. ROS parameter files have none
of these either: its own reader refuses aliases.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from ogm_mcmc.errors import OgmError
from ogm_mcmc.files.input_files import file_to_read, reason_of

__all__ = ['parse_yaml', 'read_yaml']

MOST_BYTES = 1 << 20
DEEPEST = 32
MOST_DIGITS = 40


# libyaml is ten times as fast, where PyYAML was built with it.
_Plain: Any = getattr(yaml, 'CBaseLoader', yaml.BaseLoader)
_Safe: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class _Typed(_Safe):  # type: ignore[misc]
    """Text becomes numbers, booleans and the like."""

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        if len(node.value) > MOST_DIGITS:
            raise ValueError(f'a whole number of {len(node.value)} digits')
        return int(super().construct_yaml_int(node))


_Typed.add_constructor('tag:yaml.org,2002:int', _Typed.construct_yaml_int)
# YAML 1.1 wants a point and a sign, as in 1.0e-3; ROS, YAML 1.2 and people take 1e-3 for a number.
_Typed.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+\Z'),
    list('-+.0123456789'),
)


def _check_shape(text: str) -> None:
    """Raise ValueError for anchors, aliases and deep nesting, before anything is made of them."""
    depth = 0
    for event in yaml.parse(text, Loader=_Plain):
        anchor = getattr(event, 'anchor', None)
        if anchor is not None:
            raise ValueError(f'anchor or alias {anchor!r}: expected none')
        if isinstance(event, yaml.NodeEvent) and depth >= DEEPEST:
            raise ValueError(f'nested more than {DEEPEST} levels deep')
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def parse_yaml(text: str, *, typed: bool = True) -> Any:
    """Return what a YAML text holds; every scalar as text unless `typed`.

    Raises ValueError, in one line, for what is no such YAML.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f'{len(text)} characters: expected at most {MOST_BYTES}')
    try:
        _check_shape(text)
        return yaml.load(text, _Typed if typed else _Plain)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise ValueError(reason_of(error)) from error
    except (LookupError, AttributeError) as error:  # PyYAML does not look before it takes apart
        raise ValueError('a tag such as !!int or !!bool with a value that is none') from error


def read_yaml(path: Path, what: str, error: type[OgmError], *, typed: bool = True) -> Any:
    """Return what a YAML file holds.

    what   how the message names it: `map YAML`
    Raises `error`: '<path>: expected a readable <what> (<reason>)'.
    """
    try:
        with file_to_read(path) as stream:
            content = stream.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise ValueError(f'more than {MOST_BYTES} bytes')
        return parse_yaml(content.decode('utf-8'), typed=typed)
    except (OSError, ValueError) as reason:
        raise error(f'{path}: expected a readable {what} ({reason_of(reason)})') from reason
