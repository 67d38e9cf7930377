"""Pictures of experiments: whole or not at all, and one line where there is no place for them."""

import re

import pytest

from ogm_mcmc.cli.main import run
from ogm_mcmc.errors import OutputError
from ogm_mcmc.lab.experiments.results import save_picture

# Calls that write in place: to no file of `replacing` and to no stream in memory.
IN_PLACE = re.compile(r'(?<!temporary)\.write_(?:bytes|text)\(|\.save(?:fig)?\((?!stream)')


def test_a_picture_takes_the_place_of_an_earlier_one(tmp_path):
    path = tmp_path / 'fig.png'
    save_picture(path, b'first')
    save_picture(path, b'second')
    assert path.read_bytes() == b'second'
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ('name', 'reason'),
    [('folder', 'is a folder; expected'), ('nowhere/fig.png', r'cannot be written \(')],
)
def test_no_place_for_a_picture(tmp_path, name, reason):
    (tmp_path / 'folder').mkdir()
    with pytest.raises(OutputError, match=f'{name}: {reason}'):
        save_picture(tmp_path / name, b'png')
    assert [path.name for path in tmp_path.iterdir()] == ['folder']


@pytest.mark.parametrize(
    ('name', 'picture'), [('counting', 'counting.png'), ('random-field', 'fig2.png')]
)
def test_a_folder_named_like_a_picture_is_one_line(tmp_path, capsys, name, picture):
    (tmp_path / picture).mkdir()
    assert run(['experiment', name, '--quick', '-o', str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f'{picture}: is a folder; expected a name for a file' in line
    assert [path.name for path in tmp_path.iterdir()] == [picture]


def test_no_experiment_writes_in_place(repository):
    found = {
        path.name: calls
        for path in (repository / 'ogm_mcmc' / 'experiments').glob('*.py')
        if (calls := IN_PLACE.findall(path.read_text(encoding='utf-8')))
    }
    assert found == {}
