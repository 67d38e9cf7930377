"""Parameter files as ROS reads them, and plain ones."""

import pytest

from ogm_mcmc.config import MapperConfig, build
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.io.parameter_files import read_parameter_file


def parameters(tmp_path, text):
    path = tmp_path / 'parameters.yaml'
    path.write_text(text, encoding='utf-8')
    return read_parameter_file(path)


IN_EVERY_FORM = {
    'ros, any node': '/**:\n  ros__parameters:\n    prior: 0.4\n    step:\n      l_occ: 2.0\n',
    'ros, one node': 'online_mapper:\n  ros__parameters:\n    prior: 0.4\n    step.l_occ: 2.0\n',
    'plain': 'prior: 0.4\nstep:\n  l_occ: 2.0\n',
    'plain, dotted': 'prior: 0.4\nstep.l_occ: 2.0\n',
}


@pytest.mark.parametrize('form', IN_EVERY_FORM)
def test_parameter_files(tmp_path, form):
    values = parameters(tmp_path, IN_EVERY_FORM[form])
    assert values == {'prior': 0.4, 'step.l_occ': 2.0}
    assert build(MapperConfig, values).step.l_occ == 2.0


def test_values_keep_their_types(tmp_path):
    text = 'a: 1\nb: 1.0\nc: yes\nd: text\ne: [1, 2]\nf:\n  g:\n    h: 1e-3\n'
    values = parameters(tmp_path, text)
    assert values == {'a': 1, 'b': 1.0, 'c': True, 'd': 'text', 'e': [1, 2], 'f.g.h': 0.001}
    assert [type(values[key]) for key in 'ab'] == [int, float]


def test_numbers_are_written_as_ros_takes_them(tmp_path):
    text = 'a: [1e3, -2E-1, +.5e+2, 3.e0]\nb: ["1e3", e3, 1e, 1e3m, 0x1e3]\n'
    values = parameters(tmp_path, text)
    assert values == {'a': [1000.0, -0.2, 50.0, 3.0], 'b': ['1e3', 'e3', '1e', '1e3m', 0x1E3]}


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'', 'expected a mapping of parameter names to values'),
        (b'- 1\n- 2\n', 'expected a mapping'),
        (b'just text', 'expected a mapping'),
        (b'/**:\n  ros__parameters:\n', 'expected a mapping'),
        (b'/**:\n  ros__parameters: [1]\n', 'expected a mapping'),
        (b'a: [1, 2', r'expected a readable YAML parameter file \(while parsing'),
        (b'a: \xff\xfe', 'expected a readable YAML parameter file'),
        (b'a: !!python/object:os.system {}', 'could not determine a constructor'),
    ],
)
def test_files_that_cannot_be_read(tmp_path, content, message):
    path = tmp_path / 'bad.yaml'
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        read_parameter_file(path)
    assert str(caught.value).startswith(f'{path}: ')
    assert '\n' not in str(caught.value)


def test_a_missing_file_and_a_folder(tmp_path):
    for path in (tmp_path / 'none.yaml', tmp_path):
        with pytest.raises(ConfigError, match='expected a readable YAML parameter file'):
            read_parameter_file(path)


def test_file_of_several_nodes_as_ros_reads_it(tmp_path):
    """In the order of the file, for all nodes or for one; another node's are not ours."""
    path = tmp_path / 'robot.yaml'
    path.write_text(
        'amcl:\n  ros__parameters:\n    resolution: 0.5\n'
        '/**:\n  ros__parameters:\n    resolution: 0.3\n    prior: 0.4\n'
        'online_mapper:\n  ros__parameters:\n    resolution: 0.2\n'
    )
    assert read_parameter_file(path) == {'resolution': 0.2, 'prior': 0.4}
    assert read_parameter_file(path, 'amcl') == {'resolution': 0.3, 'prior': 0.4}
    assert read_parameter_file(path, 'planner') == {'resolution': 0.3, 'prior': 0.4}


@pytest.mark.parametrize(
    'block',
    [
        '/tb1/online_mapper: {}',
        'tb1: {{online_mapper: {}}}',
        '/**/online_mapper: {}',
        '/tb1/**: {}',
        '/tb1/*: {}',
        '/*/online_mapper: {}',
        '/tb1: {{"**": {}}}',
        '/*/*: {}',
        '/tb1/**/online_mapper: {}',
        '/**/tb1/**: {}',
        '/*: {}',
        '/**/*: {}',
    ],
)
def test_a_block_of_a_node_in_a_namespace(tmp_path, block):
    """`ros2 param dump /tb1/online_mapper` writes the first; it was left aside without a word."""
    text = block.format('{ros__parameters: {prior: 0.4}}')
    others = '/**: {ros__parameters: {prior: 0.3}}\namcl: {ros__parameters: {prior: 0.1}}\n'
    assert parameters(tmp_path, f'{others}\n{text}') == {'prior': 0.4}
    assert parameters(tmp_path, f'{text}\n{others}') == {'prior': 0.3}


@pytest.mark.parametrize(
    ('names', 'read'),
    [
        (('a/online_mapper', '/a/online_mapper'), 'ab'),  # one node
        (('/a/online_mapper', '/b/**'), 'a'),  # the node that is named
        (('/b/**', '/a/online_mapper'), 'b'),
        (('/*/online_mapper', '/a/**'), 'ab'),
        (('/**', '/a/**'), 'ab'),
        (('/**/online_mapper', '/a/**'), 'ab'),
        (('/a(/**', '/**'), 'a'),  # no name of ROS, and no pattern either
    ],
)
def test_blocks_that_fit_the_node_in_its_namespace(tmp_path, names, read):
    lines = [
        f'{name}: {{ros__parameters: {{{key}: 1, last: {key}}}}}'
        for name, key in zip(names, 'ab', strict=True)
    ]
    expected = dict.fromkeys(read, 1) | {'last': read[-1]}
    assert parameters(tmp_path, '\n'.join(lines)) == expected


@pytest.mark.parametrize(
    ('names', 'message'),
    [
        (
            ('amcl', '/tb1/planner'),
            r'nothing for online_mapper in it, only amcl, /tb1/planner: exp',
        ),
        (('/tb1/online_mapper', '/tb2/online_mapper'), 'expected one block for online_mapper'),
        (('online_mapper', '/tb2/online_mapper'), 'expected one block for online_mapper'),
        (('/tb1/**', '/tb2/**'), r'/tb1/\*\* and /tb2/\*\*: expected one block for onl'),
        (('/tb1/amcl', '/tb1/online_mapper/sub'), 'nothing for online_mapper in it'),
    ],
)
def test_files_that_are_not_for_this_node(tmp_path, names, message):
    text = ''.join(f'{name}:\n  ros__parameters:\n    prior: 0.4\n' for name in names)
    with pytest.raises(ConfigError, match=message):
        parameters(tmp_path, text)
