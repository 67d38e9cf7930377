"""`sample` that goes on where it was, and that is ended before it is done."""

import json
import os
import signal
import threading

import numpy as np
import pytest
from support.commands import command
from support.office import COARSE, FEW, probability

from ogm_mcmc.cli.main import run
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import OutputError
from ogm_mcmc.files.signals import leave_on_signals


def test_a_state_goes_on_as_if_nothing_had_happened(sample, tmp_path):
    whole = sample('-o', 'whole', *FEW)
    first = sample('-o', 'parts', *FEW, '--max-sweeps', '50', '--state', 'state.npz')
    second = sample('-o', 'parts', *FEW, '--max-sweeps', '30', '--state', 'state.npz')
    assert (first['resumed_at'], second['resumed_at']) == (0, 50)
    assert second['sweeps'] == whole['sweeps'] == 80
    assert second['counted'] == whole['counted']
    assert np.array_equal(
        probability(tmp_path / 'parts'), probability(tmp_path / 'whole'), equal_nan=True
    )
    other = sample('-o', 'other', *FEW, '--seed', '2')
    assert other['settings']['chain.seed'] == 2
    assert not np.array_equal(
        probability(tmp_path / 'other'), probability(tmp_path / 'whole'), equal_nan=True
    )


def test_a_state_of_something_else_is_refused(sample, tmp_path, office_bag, capsys):
    few = ('-o', 'out', *FEW, '--state', 'state.npz')
    sample(*few)
    before = (tmp_path / 'state.npz').read_bytes()
    for change, reason in (
        (('--seed', '5'), 'expected chain.seed 1, as it was saved with, not 5'),
        (('--clutter', '0.06'), 'expected model.clutter 0.05, as it was saved with, not 0.06'),
        (('--resolution', '0.25'), 'expected window.resolution 0.2, as it was saved'),
        (('--max-scans', '7'), 'a state of other scans: expected one of those of this window'),
    ):
        assert run(['sample', str(office_bag), *few, *change]) == 2
        assert reason in capsys.readouterr().err
    assert (tmp_path / 'state.npz').read_bytes() == before


@pytest.mark.parametrize('how', [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_a_polite_kill_end_sampling_and_save(sample, tmp_path, monkeypatch, how):
    really = Refinement.run

    def soon_interrupted(self, stop, *cancelled):
        if cancelled:  # not what only warms up
            threading.Timer(0.5, os.kill, (os.getpid(), how)).start()
        return really(self, stop, *cancelled)

    monkeypatch.setattr(Refinement, 'run', soon_interrupted)
    leave_on_signals()  # as every command does
    handler = signal.getsignal(how)
    endless = ('--max-time', '100', '--max-sweeps', '1000000', '--r-hat', '0', '--burn-in', '1')
    result = sample('-o', 'out', *COARSE, *endless, '--state', 'state.npz', '--samples', '100000')
    assert result['reason'] == 'cancelled'
    assert result['sampling_seconds'] < 20.0
    assert result['counted'] > 0
    assert np.isfinite(probability(tmp_path / 'out')).any()
    assert (tmp_path / 'state.npz').stat().st_size > 0
    assert 'samples' not in result['files']
    assert result['maps_drawn'] == 0
    assert signal.getsignal(how) is handler


@pytest.mark.parametrize('how', [signal.SIGINT, signal.SIGTERM])
def test_an_end_before_the_first_sweep_is_said(office_bag, tmp_path, monkeypatch, capsys, how):
    monkeypatch.setattr(
        'ogm_mcmc.cli.sample.warm_up_sampling', lambda _: os.kill(os.getpid(), how)
    )
    code, _, err = command(capsys, 'sample', office_bag, '-o', tmp_path / 'out')
    assert code == {signal.SIGINT: 130, signal.SIGTERM: 143}[how]
    assert err.splitlines()[-1] == (
        'stopped before the first sweep: nothing was sampled, and nothing is written'
    )
    assert not (tmp_path / 'out').exists()


def test_a_second_ctrl_c_is_said(office_bag, tmp_path, monkeypatch, capsys):
    def stopped(*_):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr('ogm_mcmc.cli.sample.sample', stopped)
    code, _, err = command(capsys, 'sample', office_bag, '-o', tmp_path / 'out', *COARSE)
    assert code == 130
    assert err.splitlines()[-1] == 'stopped twice: the map is not written'
    assert not (tmp_path / 'out').exists()


def test_a_state_that_cannot_be_written_does_not_cost_the_map(
    office_bag, tmp_path, monkeypatch, capsys
):
    def full_disk(self, path):
        raise OutputError(f'{path}: No space left on device')

    monkeypatch.setattr(Refinement, 'save', full_disk)
    monkeypatch.chdir(tmp_path)
    options = ('-o', 'out', *FEW, '--max-scans', '200', '--state', 'state.npz')
    assert run(['sample', str(office_bag), *options]) == 1
    printed = capsys.readouterr()
    assert 'No space left' in printed.err
    assert 'state' not in json.loads(printed.out)
    assert np.isfinite(probability(tmp_path / 'out')).any()


def test_an_end_before_the_burn_in_is_said(sample, office_bag, capsys):
    result = sample('-o', 'out', *COARSE, '--burn-in', '1000', '--max-time', '0.05')
    assert (result['reason'], result['counted'], result['r_hat_p99']) == ('time', 0, None)
    arguments = ['-o', 'out', *COARSE[:-1], '--burn-in', '1000', '--max-time', '0.05']
    assert run(['sample', str(office_bag), *arguments]) == 0
    assert 'before the end of the burn-in: no posterior mean yet' in capsys.readouterr().out
