"""Which commands there are, which of them are imported, and what happens to what they print."""

import sys
import threading
from argparse import Namespace

import pytest

from ogm_mcmc.cli import demo_input, main
from ogm_mcmc.files.saying import said_if_slow, say


def commands(parser):
    (held,) = (action for action in parser._actions if action.dest == 'command')
    return list(held.choices)


def test_every_command_goes_by_the_name_that_its_module_gives_it():
    assert commands(main.make_parser()) == list(main.COMMANDS)


@pytest.mark.parametrize('command', main.COMMANDS)
def test_only_the_command_in_use_is_made(command, capsys, monkeypatch):
    made = []
    really = main.make_parser
    monkeypatch.setattr(
        main, 'make_parser', lambda names: made.append(list(names)) or really(names)
    )
    with pytest.raises(SystemExit):
        main.run([command, '--help'])
    assert made == [[command]]
    assert f'usage: ogm_mcmc {command} ' in capsys.readouterr().out


def test_memory_that_is_not_there_is_one_line(monkeypatch, capsys):
    def run(options):
        raise MemoryError('Unable to allocate 8 TiB')

    monkeypatch.setattr('ogm_mcmc.cli.evaluate.run', run)
    assert main.run(['evaluate', 'map.npz']) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert 'error: out of memory (Unable to allocate 8 TiB): expected a coarser' in said[0]


@pytest.mark.parametrize('words', [[], ['--help'], ['mapp']])
def test_otherwise_all_of_them_are_named(words, capsys):
    with pytest.raises(SystemExit):
        main.run(words)
    printed = capsys.readouterr()
    if words == ['--help']:
        assert set(main.COMMANDS) <= set(printed.out.split())
    elif words:
        assert "invalid choice: 'mapp'" in printed.err
        assert all(f"'{command}'" in printed.err for command in main.COMMANDS)
    else:
        assert 'required: COMMAND' in printed.err


def test_what_is_wrong_is_said_in_one_line(capsys):
    """The usage of a command with many options fills a screen; what is wrong was below it."""
    with pytest.raises(SystemExit) as stopped:
        main.run(['sample', 'bag', '-o', 'out', '--chains', '1.5'])
    assert stopped.value.code == 2
    assert capsys.readouterr().err.splitlines() == [
        "ogm_mcmc sample: error: argument --chains/--chain.chains: invalid int value: '1.5' "
        '(options: ogm_mcmc sample -h)'
    ]
    with pytest.raises(SystemExit) as stopped:
        main.run(['sample', 'bag', '-o', 'out', '--chain', '2', '--colour', 'red'])
    assert stopped.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith('(options: ogm_mcmc sample -h)')


@pytest.fixture
def full():
    """A stream on a disk that is full; it writes every line at once, as standard error does."""
    with open('/dev/full', 'w', buffering=1) as stream:
        yield stream
        stream.buffer.raw.close()  # or the rest would be tried again


def test_output_that_cannot_be_written_is_one_line(full, tmp_path, monkeypatch, capsys):
    poses = tmp_path / 'poses.tum'
    poses.write_text('20.0 1 2 0 0 0 0 1\n21.0 1 3 0 0 0 0 1\n')
    dropped = []
    monkeypatch.setattr('ogm_mcmc.cli.options.drop_output', lambda: dropped.append(1))
    monkeypatch.setattr(sys, 'stdout', full)
    assert main.run(['info', str(poses)]) == 2
    assert dropped == [1]
    error = 'ogm_mcmc info: error: standard output: cannot be written (No space left on device)\n'
    assert capsys.readouterr().err == error


def test_a_note_that_cannot_be_written_costs_no_work(full, monkeypatch):
    """A map was not made because standard error was on a full disk."""
    monkeypatch.setattr(sys, 'stderr', full)
    say('poses from /pose')


def test_an_error_that_cannot_be_written_keeps_its_code(full, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'stderr', full)
    assert main.run(['info', str(tmp_path / 'none')]) == 2


@pytest.mark.parametrize('given', ['log', 'office'])
def test_a_demo_that_cannot_say_what_it_replays_goes_on(full, given, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'stderr', full)
    monkeypatch.setattr(demo_input, 'write_recording', lambda *_, **__: 1)
    monkeypatch.setattr(demo_input, 'record', lambda *_: None)
    monkeypatch.setattr(demo_input, 'import_carmen', lambda *_, **__: None)
    monkeypatch.setattr(demo_input, 'describe', lambda _: 'a log')
    monkeypatch.setattr(demo_input, '_looked_into', lambda bag, _: bag)
    (tmp_path / 'a.log').touch()
    path = tmp_path / 'a.log' if given == 'log' else None
    options = Namespace(field_of_view=0.0)
    assert demo_input.prepare(path, tmp_path, options) == tmp_path / 'recording'


def test_work_that_takes_long_is_said_while_it_goes_on(monkeypatch):
    said = threading.Event()
    monkeypatch.setattr('ogm_mcmc.files.saying.say', lambda _: said.set())
    with said_if_slow('compiling', 0.0):
        assert said.wait(10.0)
    said.clear()
    with said_if_slow('compiling', 60.0):
        pass
    assert not said.is_set()
