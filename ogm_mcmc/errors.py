"""What can go wrong, as exceptions whose message is the one line a user needs.

Every message names the thing, the offending value and what was expected. The library raises;
`ogm_mcmc.cli` prints and exits with 2; `ogm_mcmc.ros` warns, throttled, and counts.
"""

import os
from collections.abc import Sequence

__all__ = [
    'BagError',
    'ClusterError',
    'ConfigError',
    'GridError',
    'LogError',
    'MapFileError',
    'OgmError',
    'OutputError',
    'PointsError',
    'PoseError',
    'PriorError',
    'ScanError',
    'WindowError',
    'WindowFullError',
    'PLAIN_NAME_EXPECTED',
    'is_plain_name',
    'listed',
    'require',
]

# Bytes; a file name may have 255, and endings such as _trajectory_deviations.csv come on top.
LONGEST_NAME = 200

PLAIN_NAME_EXPECTED = (
    'expected a file name without folders, printable, not hidden (a point first), '
    f'of at most {LONGEST_NAME} bytes'
)


# So many names are told of many.
MOST_LISTED = 20


class OgmError(Exception):
    """Base of every error this package raises on purpose."""


class ConfigError(OgmError, ValueError):
    """A setting is outside what it may be."""


class GridError(OgmError, ValueError):
    """A grid does not fit: another lattice, or larger than allowed."""


class ScanError(OgmError, ValueError):
    """A laser scan that contradicts itself."""


class PoseError(OgmError, ValueError):
    """A pose or belief over poses that cannot be used."""


class BagError(OgmError, ValueError):
    """A bag that cannot be read, or that lacks what is needed."""


class LogError(OgmError, ValueError):
    """A CARMEN or GMapping log that cannot be read."""


class MapFileError(OgmError, ValueError):
    """A map file that cannot be read."""


class PointsError(OgmError, ValueError):
    """A file of points that cannot be read."""


class WindowError(OgmError, ValueError):
    """A window of scans that cannot be sampled: nothing in it, or more than memory allows."""


class WindowFullError(WindowError):
    """A window whose index would be larger than its limit: fewer scans may do."""


class PriorError(OgmError, ValueError):
    """A patch prior that cannot be learned, read or used."""


class ClusterError(OgmError, RuntimeError):
    """A cluster that does not answer, or lost work for good."""


class OutputError(OgmError, OSError):
    """A place that cannot be written to."""


def require(condition: bool, name: str, value: object, expectation: str) -> None:
    """Raise `ConfigError` '<name> is <value>: <expectation>' unless the condition holds."""
    if not condition:
        raise ConfigError(f'{name} is {value!r}: {expectation}')


def is_plain_name(name: str) -> bool:
    """Whether a name is that of a file, not of a path, not hidden, printable and short enough."""
    plain = name.isprintable() and not name.startswith('.') and not {'/', '\\'} & set(name)
    return bool(name) and plain and len(os.fsencode(name)) <= LONGEST_NAME


def listed(names: Sequence[str], separator: str = ', ') -> str:
    """Return names for a message, the first of them where there are very many."""
    shown = separator.join(names[:MOST_LISTED])
    left = len(names) - MOST_LISTED
    return f'{shown}{separator}and {left} more' if left > 0 else shown
