"""A plugin of mypy: types of compiled kernels are not checked, in modules named `*_kernels`.

Patterns in `setup.cfg` match whole parts of a module's name only, and a list of all such modules
was one more place to touch for everybody who adds a kernel. Numba takes the types from the
arguments; what calls a kernel is checked as everything else.
"""

from __future__ import annotations

from pathlib import Path

from mypy.options import Options
from mypy.plugin import Plugin

__all__ = ['Kernels', 'plugin']

ROOT = Path(__file__).resolve().parents[1]

UNCHECKED = (
    'disallow_untyped_decorators',
    'disallow_untyped_defs',
    'disallow_untyped_calls',
    'disallow_incomplete_defs',
)


class Kernels(Plugin):
    """Changes options of modules; has nothing to say about types."""

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        for path in sorted((ROOT / 'ogm_mcmc').rglob('*_kernels.py')):
            name = '.'.join(path.relative_to(ROOT).with_suffix('').parts)
            options.per_module_options[name] = dict.fromkeys(UNCHECKED, False)


def plugin(version: str) -> type[Plugin]:
    """Return the plugin; mypy asks for it with its version."""
    return Kernels
