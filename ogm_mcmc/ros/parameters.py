"""Config classes as ROS parameters: descriptions and ranges out, checked values in."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ogm_mcmc.config import Setting, build, settings_of
from ogm_mcmc.errors import ConfigError

__all__ = ['ParameterSet']

T = TypeVar('T')

# Parameters that rclpy itself reads.
OTHERS = ('use_sim_time', 'qos_overrides.', 'start_type_description_service')


def descriptor(leaf: Setting, live: bool) -> ParameterDescriptor:
    """Return the descriptor of a setting: what it means, what it may be, when it may change."""
    text = leaf.description
    if leaf.choices:
        text += f'; one of {", ".join(leaf.choices)}'
    if not live:
        text += ' (fixed at start)'
    result = ParameterDescriptor(name=leaf.name, description=text, read_only=not live)
    low, high = leaf.low, leaf.high
    if leaf.type is float and low is not None and high is not None:
        result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif leaf.type is int and low is not None and high is not None:
        result.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return result


class ParameterSet:
    """Declares the leaves of config classes on a node and builds the config objects.

    `agree(values)` raises ConfigError when settings of different classes contradict each other.
    """

    def __init__(
        self,
        node: Node,
        configs: Iterable[type],
        live: frozenset[str],
        agree: Callable[[dict[str, Any]], None] = lambda values: None,
    ) -> None:
        self.node = node
        self.configs = tuple(configs)
        self.live = live
        self.agree = agree
        self._names: dict[type, list[str]] = {}  # to ask for all of them takes milliseconds
        self.leaves = {leaf.name: leaf for config in self.configs for leaf in settings_of(config)}
        for leaf in self.leaves.values():
            try:
                node.declare_parameter(
                    leaf.name, leaf.default, descriptor(leaf, leaf.name in live)
                )
            except (InvalidParameterTypeException, InvalidParameterValueException) as error:
                raise ConfigError(f'parameter {leaf.name}: {error}') from error

        self._warn_of_unknown()
        self.agree(self.values())

    def _warn_of_unknown(self) -> None:
        """Warn about given parameters that no setting reads, such as a misspelt name."""
        # rclpy offers no public way to what a parameter file or the command line gave.
        given = set(getattr(self.node, '_parameter_overrides', {}))
        for name in sorted(given):
            if name not in self.leaves and not name.startswith(OTHERS):
                self.node.get_logger().warning(f'parameter {name} is not known and has no effect')

    def live_of(self, config: type) -> frozenset[str]:
        """Return the names of a config class that may change at run time."""
        return self.live & {leaf.name for leaf in settings_of(config)}

    def values(self) -> dict[str, Any]:
        """Return all current values by dotted name."""
        return {name: self.node.get_parameter(name).value for name in self.leaves}

    def read(self, config: type[T]) -> T:
        """Build one config object from the current values; raises ConfigError."""
        names = self._names.get(config)
        if names is None:
            names = self._names[config] = [leaf.name for leaf in settings_of(config)]
        return build(config, {name: self.node.get_parameter(name).value for name in names})

    def refused(self, changes: Iterable[Parameter]) -> SetParametersResult | None:
        """Return why a change is refused that names a fixed parameter, or none; else None."""
        for change in changes:
            if not self.node.has_parameter(change.name):  # what rclpy says does not name it
                reason = f'{change.name} is not known; ros2 param list shows what is'
                return SetParametersResult(successful=False, reason=reason)
            if change.name in self.leaves and change.name not in self.live:
                reason = (
                    f'{change.name} is fixed at start: what was mapped, or how the node is '
                    f'connected, depends on it; changeable: {", ".join(sorted(self.live))}'
                )
                return SetParametersResult(successful=False, reason=reason)
        return None

    def check(self, changes: Iterable[Parameter]) -> SetParametersResult:
        """Judge a change at run time: safe ones pass, others are refused with the reason."""
        values = self.values()
        values.update((one.name, one.value) for one in changes if one.name in self.leaves)
        try:
            for config in self.configs:
                build(config, values, ignore_unknown=True)
            self.agree(values)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)
