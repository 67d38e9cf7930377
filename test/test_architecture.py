"""Core modules import without ROS, and carry what every module has to."""

import ast
import importlib
import pkgutil
import subprocess
import sys

import pytest

import ogm_mcmc

NEEDS_ROS = ('ogm_mcmc.ros.',)

MODULES = sorted(module.name for module in pkgutil.walk_packages(ogm_mcmc.__path__, 'ogm_mcmc.'))
CORE = [name for name in MODULES if not (name.startswith(NEEDS_ROS) or name.endswith('__main__'))]


def test_core_imports_where_ros_is_not_installed():
    """In a process of its own, in which every ROS package is hidden."""
    assert len(CORE) > 40
    hidden = ('rclpy', 'nav_msgs', 'sensor_msgs', 'geometry_msgs', 'std_srvs', 'rcl_interfaces')
    code = (
        'import importlib, sys\n'
        f'sys.modules.update(dict.fromkeys({hidden!r}))\n'
        f'for name in {CORE!r}: importlib.import_module(name)\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('name', CORE)
def test_modules_have_a_docstring_and_a_true_menu(name):
    module = importlib.import_module(name)
    assert module.__doc__, f'{name} has no docstring'
    for item in getattr(module, '__all__', ()):
        assert hasattr(module, item), f'{name}.__all__ names {item}, which is not there'


def test_core_never_prints(repository):
    """Only the command line prints; nodes log."""
    allowed = ('cli', 'ros/running.py', 'ros/replay.py')
    for path in sorted((repository / 'ogm_mcmc').rglob('*.py')):
        relative = path.relative_to(repository / 'ogm_mcmc').as_posix()
        if relative.startswith(allowed):
            continue
        tree = ast.parse(path.read_text(encoding='utf-8'))
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        printed = [c.lineno for c in calls if getattr(c.func, 'id', '') == 'print']
        assert printed == [], f'{relative} prints in line {printed}'
