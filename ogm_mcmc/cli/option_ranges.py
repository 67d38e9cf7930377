"""What numbers an option may have, said of the option as it is typed and in its own unit.

For options that are converted, or handed to something with names and units of its own: its
complaint would speak of a value that the user did not type. Settings check themselves
(`ogm_mcmc.config`).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import NamedTuple

from ogm_mcmc.errors import ConfigError

__all__ = ['Range', 'check_options', 'is_given', 'option_name', 'refused']


class Range(NamedTuple):
    """From `low` to `high`, in a unit; `below`: `high` itself is too much."""

    low: float = -math.inf
    high: float = math.inf
    unit: str = ''
    below: bool = False

    def holds(self, value: float) -> bool:
        """Whether a number lies inside; nan and infinity never do."""
        # A whole number may be too large for any float, so no math.isfinite.
        inside = self.low <= value < self.high if self.below else self.low <= value <= self.high
        return inside and abs(value) < math.inf

    def __str__(self) -> str:
        """Return what is expected, as "0 to 360 degrees"."""
        unit = f' {self.unit}' if self.unit else ''
        if self.high == math.inf:
            return f'{self.low:g} or more{unit}' if self.low > -math.inf else f'a number{unit}'
        return f'{self.low:.15g} to {"below " if self.below else ""}{self.high:.15g}{unit}'


def check_options(options: argparse.Namespace, ranges: Mapping[str, Range]) -> None:
    """Refuse options out of their ranges, by name; those not given (None) are left alone."""
    for name, allowed in ranges.items():
        value = getattr(options, name)
        for number in value if isinstance(value, list) else [value]:
            if number is not None and not allowed.holds(number):
                raise refused(name, number, f'expected {allowed}')


def is_given(options: argparse.Namespace, name: str) -> bool:
    """Whether an option was typed; for those whose default is None, and for switches."""
    value = getattr(options, name)
    return value is not None and value is not False  # 0 is given


def option_name(name: str) -> str:
    """Return the option of a name in the namespace."""
    return f'--{name.replace("_", "-")}'


def refused(name: str, value: float, expectation: str) -> ConfigError:
    """Return the error '--option is 720: expected 0 to 360 degrees'."""
    shown = f'{value:.15g}' if isinstance(value, float) else value
    return ConfigError(f'{option_name(name)} is {shown}: {expectation}')
