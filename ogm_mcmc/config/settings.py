"""Settings: frozen dataclasses whose fields carry description and bounds.

One declaration serves the Python constructor, the YAML file, the ROS parameter descriptor and
the table in `docs/parameters.md`. Nested classes become dotted names (`step.l_occ`). A wrong
value is refused with the reason, never repaired.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, TypeVar, get_type_hints

from ogm_mcmc.errors import ConfigError, require

__all__ = [
    'Setting',
    'add_arguments',
    'build',
    'check_bounds',
    'flatten',
    'given',
    'setting',
    'settings_of',
]

T = TypeVar('T')


@dataclass(frozen=True)
class Setting:
    """One leaf of a config class; `live` and `parameter` as `setting` has them."""

    name: str
    type: type
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False
    parameter: bool = True


def setting(
    default: Any,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    live: bool = False,
    parameter: bool = True,
) -> Any:
    """Declare a dataclass field with its description and inclusive bounds.

    A `live` one may change while a node runs. One that is no `parameter` is a switch for
    experiments: Python code sets it, nodes and commands do not offer it.
    """
    facts = {'description': description, 'low': low, 'high': high}
    return field(
        default=default,
        metadata={**facts, 'choices': choices, 'live': live, 'parameter': parameter},
    )


def settings_of(
    cls: type, prefix: str = '', example: Any = None, *, switches: bool = False
) -> Iterator[Setting]:
    """Walk over the leaves of a config class, depth first, in order of declaration.

    With `switches` those that are no parameters are among them.

    Defaults are those of `example`, an object of the class, where there is one: a class may give
    a nested one other defaults than its own.
    """
    hints = _hints(cls)
    for item in dataclasses.fields(cls):
        kind: type = hints[item.name]
        default = item.default if example is None else getattr(example, item.name)
        if hasattr(kind, '__dataclass_fields__'):
            # A default of a subclass brings the texts and choices of that.
            own = default.__class__ if isinstance(default, kind) else kind
            yield from settings_of(own, f'{prefix}{item.name}.', default, switches=switches)
        elif switches or item.metadata['parameter']:
            yield Setting(f'{prefix}{item.name}', kind, default, **item.metadata)


# Annotations are text: to compile them takes longer than all the rest of a change of parameters.
@lru_cache(maxsize=256)
def _hints(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


@lru_cache(maxsize=256)
def _leaves(cls: type) -> tuple[Setting, ...]:
    return tuple(settings_of(cls, switches=True))


def check_bounds(config: Any) -> None:
    """Refuse a config object with a leaf of the wrong type or out of bounds."""
    values = flatten(config)
    for leaf in _leaves(config.__class__):
        value = values[leaf.name]
        number = leaf.type in (int, float)
        right_type = isinstance(value, leaf.type) or (leaf.type is float and type(value) is int)
        if leaf.type is not bool and isinstance(value, bool):
            right_type = False
        require(right_type, leaf.name, value, f'expected {leaf.type.__name__}')
        if leaf.choices:
            require(value in leaf.choices, leaf.name, value, f'one of {", ".join(leaf.choices)}')
        if number:
            low = -math.inf if leaf.low is None else leaf.low
            high = math.inf if leaf.high is None else leaf.high
            # A whole number may be too large for any float, so no math.isfinite.
            in_bounds = abs(value) < math.inf and low <= value <= high
            require(in_bounds, leaf.name, value, f'expected a number from {low:g} to {high:g}')


def flatten(config: Any, prefix: str = '') -> dict[str, Any]:
    """Dotted names and values of a config object, for files, messages and results."""
    values: dict[str, Any] = {}
    for item in dataclasses.fields(config):
        value = getattr(config, item.name)
        if dataclasses.is_dataclass(value):
            values.update(flatten(value, f'{prefix}{item.name}.'))
        else:
            values[f'{prefix}{item.name}'] = value
    return values


def add_arguments(
    parser: argparse._ActionsContainer,
    cls: type,
    without: tuple[str, ...] = (),
    short: Mapping[str, str] | None = None,
) -> None:
    """Declare one option per leaf; an option that is not given is None.

    `max_range` becomes `--max-range`, `step.l_occ` becomes `--step.l-occ`; values end up in the
    namespace under their dotted names, see `given`. `short` names a second option for some.
    """
    for leaf in settings_of(cls):
        if leaf.name in without:
            continue
        options = [f'--{leaf.name.replace("_", "-")}']
        if short is not None and leaf.name in short:
            options.insert(0, short[leaf.name])
        text = f'{leaf.description} (default: {leaf.default})'.replace('%', '%%')
        if leaf.type is bool:
            parser.add_argument(
                *options,
                dest=leaf.name,
                action=argparse.BooleanOptionalAction,
                default=None,
                help=text,
            )
        else:
            parser.add_argument(
                *options,
                dest=leaf.name,
                type=leaf.type,
                choices=leaf.choices or None,
                metavar=None if leaf.choices else leaf.type.__name__.upper(),
                help=text,
            )


def given(options: argparse.Namespace, cls: type) -> dict[str, Any]:
    """Return the settings of a config class that a command line names, by dotted name."""
    values = {leaf.name: getattr(options, leaf.name, None) for leaf in settings_of(cls)}
    return {name: value for name, value in values.items() if value is not None}


def build(cls: type[T], values: Mapping[str, Any], *, ignore_unknown: bool = False) -> T:
    """Make a config object from dotted names; what is not named keeps its default.

    Raises ConfigError for an unknown name (listing the known ones) and for a refused value.
    """
    kind: type = cls
    known = {leaf.name for leaf in _leaves(kind)}
    unknown = sorted(set(values) - known)
    if unknown and not ignore_unknown:
        raise ConfigError(f'unknown setting {unknown[0]!r}: one of {", ".join(sorted(known))}')
    return cls(**_arguments(cls, values, ''))


def _arguments(cls: type, values: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    hints = _hints(cls)
    arguments: dict[str, Any] = {}
    for item in dataclasses.fields(cls):
        name = f'{prefix}{item.name}'
        if dataclasses.is_dataclass(hints[item.name]):
            nested = _arguments(hints[item.name], values, f'{name}.')
            example: Any = item.default
            try:
                arguments[item.name] = dataclasses.replace(example, **nested)
            except ConfigError as error:
                # A nested class knows its settings by the last part of their names.
                setting_of = str(error).partition(' is ')[0]
                known = {leaf.name for leaf in settings_of(hints[item.name])}
                if setting_of not in known:
                    raise
                raise ConfigError(f'{name}.{error}') from error
        elif name in values:
            arguments[item.name] = values[name]
    return arguments
