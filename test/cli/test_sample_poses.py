"""`sample` where poses are estimated first, and that is ended."""

import json

import pytest
from support.rooms import noisy_drive

from ogm_mcmc.cli.main import run
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.recording_bag import write_recording


@pytest.mark.parametrize('usable', [False, True])
def test_ctrl_c_ends_poses_and_begins_sampling(tmp_path, monkeypatch, capsys, usable):
    write_recording(tmp_path / 'noisy', noisy_drive()[1])

    def ended(poses, interrupted):
        if usable:
            list(poses.run(cancelled=lambda: poses.usable))
        assert poses.usable == usable
        interrupted.set()

    monkeypatch.setattr('ogm_mcmc.cli.sample.refine_poses', ended)
    call = ['sample', tmp_path / 'noisy', '-o', tmp_path / 'out', '--resolution', '0.1', '--json']
    limits = ['--max-sweeps', '3', '--burn-in', '1', '--r-hat', '0', '--poses', 'joint']
    assert run([str(one) for one in (*call, *limits)]) == 0
    said = capsys.readouterr()
    which = 'joint ones, as far as they are' if usable else 'those given'
    assert f'poses ended: maps are sampled at {which}; Ctrl-C ends that, too' in said.err
    assert ('trajectory' in json.loads(said.out)) == usable


@pytest.mark.parametrize(
    ('poses', 'said'),
    [
        ('fixed', 'poses are those of odometry, which drifts: --poses joint estimates them'),
        ('auto', 'poses fixed: 4 readings a scan are too few'),
    ],
)
def test_poses_of_odometry_are_said_to_drift(tmp_path, write_bag, make_scan, capsys, poses, said):
    stamps = [(1 + k) * 10**9 for k in range(3)]
    still = [('/odom', t, ros_types.odometry(t, Pose2D(), 0.0, 0.0)) for t in stamps]
    bag = write_bag([*still, *(('/scan', t, make_scan(t)) for t in stamps)])
    call = ['sample', str(bag), '-o', str(tmp_path / 'out'), '--resolution', '0.2']
    limits = ['--max-sweeps', '2', '--burn-in', '1', '--r-hat', '0', '--poses', poses]
    assert run([*call, *limits]) == 0
    assert said in capsys.readouterr().err.splitlines()
