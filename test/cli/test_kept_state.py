"""When the state file of `sample` is written, and what becomes of a write that fails."""

import pytest

from ogm_mcmc.cli.kept_state import EVERY_S, KeptState
from ogm_mcmc.errors import OutputError


class Chains:
    """A refinement that only counts how often it was saved, and fails when it is told to."""

    def __init__(self):
        self.saved, self.full_disk = 0, False

    def save(self, path):
        if self.full_disk:
            raise OutputError(f'{path}: No space left on device')
        self.saved += 1
        path.write_text(str(self.saved))


@pytest.fixture
def kept(tmp_path):
    chains, now = Chains(), [0.0]
    return KeptState(chains, tmp_path / 'folder' / 'state.npz', clock=lambda: now[0]), chains, now


def test_the_state_is_written_every_few_minutes(kept):
    state, chains, now = kept
    for _ in range(50):
        now[0] += EVERY_S / 10
        state.round_done()
    assert chains.saved == 5
    assert state.path.read_text() == '5'


def test_a_write_that_fails_is_said_and_tried_again(kept, capsys):
    state, chains, now = kept
    state.attempt()
    chains.full_disk = True
    now[0] += EVERY_S
    state.round_done()
    assert 'not saved' in capsys.readouterr().err
    state.round_done()  # not at once again
    assert capsys.readouterr().err == ''
    assert state.path.read_text() == '1'
    chains.full_disk = False
    now[0] += EVERY_S
    state.round_done()
    assert state.path.read_text() == '2'


def test_without_a_file_nothing_is_written(tmp_path):
    state = KeptState(Chains(), None)
    assert state.resume() == 0
    assert state.attempt() is None
    assert state.refinement.saved == 0


def test_what_was_sampled_is_kept_when_machines_are_lost(kept, capsys):
    state, chains, _ = kept
    state.rescue()
    assert chains.saved == 1
    assert str(state.path) in capsys.readouterr().err


def test_a_folder_for_a_state_that_cannot_be_written_goes_again(kept):
    state, chains, _ = kept
    chains.full_disk = True
    assert state.attempt() is not None
    assert not state.path.parent.exists()
