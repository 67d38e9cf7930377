"""Launch files, with stand-ins for launch: what they declare, start and hand on."""

import json

import pytest
import yaml
from support.launch_files import described

# Launch file and the node it starts.
FILES = {
    'online_mapper': 'online_mapper',
    'refine_server': 'refine_server',
    'nav2': 'online_mapper',
    'refine_after_slam': 'refine_server',
}


def asked(value):
    """Return the names of the arguments that a value is made from."""
    if isinstance(value, dict):
        return set().union(*map(asked, value.values()))
    if isinstance(value, list | tuple):
        return set().union(*map(asked, value))
    return set(value.args) if getattr(value, 'kind', '') == 'LaunchConfiguration' else set()


@pytest.mark.parametrize('name', FILES)
@pytest.mark.parametrize('linked', [False, True], ids=['plain', 'symlink install'])
def test_parameters_come_from_the_share_folder(repository, tmp_path, name, linked):
    path = repository / 'config' / 'launch' / f'{name}.launch.py'
    if linked:
        (tmp_path / path.name).symlink_to(path)
        path = tmp_path / path.name
    declared, _ = described(path)
    share, *rest = declared['params_file'].default_value.args[0]
    assert (share.kind, share.args) == ('FindPackageShare', ('ogm_mcmc',))
    assert rest == ['config', f'{FILES[name]}.yaml']
    assert (repository / 'config' / f'{FILES[name]}.yaml').is_file()


@pytest.mark.parametrize('name', FILES)
def test_every_argument_reaches_the_node(repository, name):
    path = repository / 'config' / 'launch' / f'{name}.launch.py'
    declared, (node, *_) = described(path)
    assert (node.executable, node.name) == (FILES[name], FILES[name])
    assert {'namespace', 'log_level', 'use_sim_time', 'params_file', 'respawn'} <= set(declared)
    values = [vars(node)[key] for key in ('namespace', 'respawn', 'arguments', 'parameters')]
    assert asked([*values, node.remappings]) == set(declared)
    for topic, argument in node.remappings:
        (name_of_it,) = asked(argument)
        assert declared[name_of_it].default_value == topic
    _, given = node.parameters
    held = yaml.safe_load((repository / 'config' / f'{FILES[name]}.yaml').read_text())
    known = held['/**']['ros__parameters']
    assert set(given) - {'use_sim_time'} <= set(known)


def test_under_nav2_a_lifecycle_manager_starts_the_mapper(repository):
    path = repository / 'config' / 'launch' / 'nav2.launch.py'
    _, (node, manager) = described(path)
    # A manager does not notice a node that comes again: then it is the node that sees to itself.
    assert asked(node.parameters[1]['autostart']) == {'respawn'}
    assert (manager.condition.kind, *map(asked, manager.condition.args)) == (
        'UnlessCondition',
        {'respawn'},
    )
    assert node.parameters[1]['pose_source'] == 'tf'
    assert manager.package == 'nav2_lifecycle_manager'
    (given,) = manager.parameters
    assert given['node_names'] == [node.name]
    assert given['bond_timeout'] == 0.0


TOPICS = {
    '/map',
    '/map_refined',
    '/map_probability',
    '/map_refined_probability',
    '/online_mapper/entropy',
    '/refine_server/entropy',
}


def test_views_show_every_map(repository):
    rviz = yaml.safe_load((repository / 'config' / 'view' / 'maps.rviz').read_text())
    displays = rviz['Visualization Manager']['Displays']
    maps = [one for one in displays if one['Class'] == 'rviz_default_plugins/Map']
    assert {one['Topic']['Value'] for one in maps} == TOPICS
    for one in maps:
        assert one['Update Topic']['Value'] == f'{one["Topic"]["Value"]}_updates'
    layout = json.loads((repository / 'config' / 'view' / 'maps.foxglove.json').read_text())
    assert set(layout['configById']['3D!maps']['topics']) >= TOPICS
