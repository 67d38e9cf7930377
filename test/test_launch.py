"""Launch files find the parameters through the ament index, wherever they lie themselves."""

import runpy
import sys
from types import ModuleType, SimpleNamespace

import pytest


def stub(monkeypatch, name, **members):
    module = ModuleType(name)
    module.__dict__.update(members)
    monkeypatch.setitem(sys.modules, name, module)


def called(kind):
    """Return a stand-in for a class of launch: it keeps what it was made with."""
    return lambda *args, **kwargs: SimpleNamespace(kind=kind, args=args, **kwargs)


@pytest.mark.parametrize('node', ['online_mapper', 'refine_server'])
@pytest.mark.parametrize('linked', [False, True], ids=['plain', 'symlink install'])
def test_parameters_come_from_the_share_folder(monkeypatch, repository, tmp_path, node, linked):
    """launch itself is not on PyPI, so its classes are stood in for."""
    kinds = {
        'launch': ['LaunchDescription'],
        'launch.actions': ['DeclareLaunchArgument'],
        'launch.substitutions': ['LaunchConfiguration', 'PathJoinSubstitution'],
        'launch_ros': [],
        'launch_ros.actions': ['Node'],
        'launch_ros.substitutions': ['FindPackageShare'],
    }
    for name, members in kinds.items():
        stub(monkeypatch, name, **{member: called(member) for member in members})
    path = repository / 'config' / 'launch' / f'{node}.launch.py'
    if linked:
        (tmp_path / path.name).symlink_to(path)
        path = tmp_path / path.name
    description = runpy.run_path(str(path))['generate_launch_description']()
    (entities,) = description.args
    (declared,) = (e for e in entities if getattr(e, 'args', ()) == ('params_file',))
    share, *rest = declared.default_value.args[0]
    assert (share.kind, share.args) == ('FindPackageShare', ('ogm_mcmc',))
    assert rest == ['config', f'{node}.yaml']
    assert (repository / 'config' / f'{node}.yaml').is_file()
