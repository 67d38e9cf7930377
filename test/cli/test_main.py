"""Which commands there are, and which of them are imported."""

import pytest

from ogm_mcmc.cli import main


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
