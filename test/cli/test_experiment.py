"""`experiment`: the files it leaves and the mistakes it names; all that are registered run."""

import inspect
import json

import pytest
from support.commands import command
from support.refusals import error_line

from ogm_mcmc.cli.main import run
from ogm_mcmc.lab.experiments import EXPERIMENTS, SPREAD


def test_files_and_text(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(['experiment', 'counting', '--quick', '--seed', '4']) == 0
    printed = capsys.readouterr().out
    assert 'reflection map' in printed
    assert '0.6000' in printed
    folder = tmp_path / 'out' / 'experiments' / 'counting'
    assert {path.name for path in folder.iterdir()} == {
        'counting.png', 'index.html', 'result.json',
    }  # fmt: skip
    result = json.loads((folder / 'result.json').read_text())
    assert (result['seed'], result['quick']) == (4, True)
    page = (folder / 'index.html').read_text()
    assert page.count('src="data:image/png;base64,') == 1
    assert 'published' in page
    assert 'http' not in page
    assert run(['experiment', 'counting', '--quick', '--json', '-o', 'there']) == 0
    again = json.loads(capsys.readouterr().out)
    assert json.loads((tmp_path / 'there' / 'result.json').read_text()) == again


def test_help_says_what_each_is_about(capsys):
    with pytest.raises(SystemExit):
        run(['experiment', '-h'])
    lines = capsys.readouterr().out.splitlines()
    for name in EXPERIMENTS:
        (about,) = [line for line in lines if line.split()[:1] == [name]]
        assert len(about.split()) > 5, name


@pytest.mark.parametrize('finished', [0, 1])
def test_who_interrupts_is_told_that_finished_parts_are_kept(
    tmp_path, monkeypatch, capsys, finished
):
    def interrupted(folder, **_):
        (folder / 'datasets').mkdir()
        for number in range(finished):
            (folder / 'datasets' / f'{number}.json').touch()
        raise KeyboardInterrupt

    monkeypatch.setitem(EXPERIMENTS, 'collisions', interrupted)
    assert run(['experiment', 'collisions', '-o', str(tmp_path / 'out')]) == 130
    said = capsys.readouterr().err
    assert said.count('the same command goes on from there') == finished


@pytest.mark.parametrize('name', sorted(EXPERIMENTS))
def test_every_experiment_keeps_the_agreement(name):
    parameters = inspect.signature(EXPERIMENTS[name]).parameters
    assert list(parameters) == ['folder', 'quick', 'seed']
    assert parameters['quick'].kind is parameters['seed'].kind is inspect.Parameter.KEYWORD_ONLY


def test_what_spreads_is_what_goes_through_run_all():
    found = {
        name for name, one in EXPERIMENTS.items() if 'run_all' in inspect.getmodule(one).__dict__
    }
    assert found == set(SPREAD)


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['moon'], 'moon'),
        (['counting', '--seed', '-1'], 'seed is -1'),
        (
            ['gibbs-1d', '--scheduler', 'tcp://127.0.0.1:9'],
            'gibbs-1d has nothing to spread; expected one of collisions, exploration, gibbs-2d, ',
        ),
        (['counting', '-o', 'notes.txt'], 'expected a writable folder'),
        (['patch-intel'], 'intel.gfs.log: no such file'),
        (['patch-stata', '-o', 'new/folder'], 'imported: no such file'),
        (['pose-particles'], 'csail.corrected.gfs: no such file'),
        (['refined-truth'], '.png: no such file; expected OGM_MCMC_DATA to name'),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, arguments, reason
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path))
    (tmp_path / 'notes.txt').write_text('nothing of use')
    code, _, err = command(capsys, 'experiment', *arguments)
    assert code == 2
    assert reason in error_line(err)
    assert [path.name for path in tmp_path.iterdir()] == ['notes.txt']


def test_a_damaged_log_leaves_no_folders(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path))
    (tmp_path / 'intel').mkdir()
    (tmp_path / 'intel' / 'intel.gfs.log').write_text('FLASER 3 1.0\n')
    assert run(['experiment', 'patch-intel', '-o', str(tmp_path / 'out')]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / 'out').exists()
