"""Launch files run with stand-ins for `launch` and `launch_ros`, which are not on PyPI.

`python test/support/launch_files.py FILE...` says where the package of each was found.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import mock

__all__ = ['described']

KINDS = {
    'launch': ['LaunchDescription'],
    'launch.actions': ['DeclareLaunchArgument'],
    'launch.conditions': ['UnlessCondition'],
    'launch.substitutions': ['LaunchConfiguration', 'PathJoinSubstitution'],
    'launch_ros': [],
    'launch_ros.actions': ['Node'],
    'launch_ros.substitutions': ['FindPackageShare'],
}


def called(kind: str) -> Callable[..., SimpleNamespace]:
    """Return a stand-in for a class of launch: it keeps what it was made with."""
    return lambda *args, **kwargs: SimpleNamespace(kind=kind, args=args, **kwargs)


def described(path: Path) -> tuple[dict[str, Any], list[Any]]:
    """Return the arguments that a launch file declares, by name, and the nodes it starts."""
    modules = {name: ModuleType(name) for name in KINDS}
    for name, members in KINDS.items():
        modules[name].__dict__.update({member: called(member) for member in members})
    with mock.patch.dict(sys.modules, modules):
        sys.modules.pop('ogm_mcmc.ros.launching', None)
        description = runpy.run_path(str(path))['generate_launch_description']()
    (entities,) = description.args
    declared = {e.args[0]: e for e in entities if e.kind == 'DeclareLaunchArgument'}
    return declared, [e for e in entities if e.kind == 'Node']


if __name__ == '__main__':
    import ogm_mcmc

    for file in sys.argv[1:]:
        _, (node, *_) = described(Path(file))
        print(f'{Path(file).name}: {node.executable}, {ogm_mcmc.__file__}')
