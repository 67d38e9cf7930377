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
    assert values == {'a': 1, 'b': 1.0, 'c': True, 'd': 'text', 'e': [1, 2], 'f.g.h': '1e-3'}
    assert [type(values[key]) for key in 'ab'] == [int, float]


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
    """All nodes' values, then our own; another node's are none of our business."""
    path = tmp_path / 'robot.yaml'
    path.write_text(
        'amcl:\n  ros__parameters:\n    resolution: 0.5\n'
        'online_mapper:\n  ros__parameters:\n    resolution: 0.2\n'
        '/**:\n  ros__parameters:\n    resolution: 0.3\n    prior: 0.4\n'
    )
    assert read_parameter_file(path) == {'resolution': 0.2, 'prior': 0.4}
    assert read_parameter_file(path, 'amcl') == {'resolution': 0.5, 'prior': 0.4}
    assert read_parameter_file(path, 'planner') == {'resolution': 0.3, 'prior': 0.4}
