"""`evaluate --estimate`: poses before true ones and relations, and the mistakes it names."""

import json

import numpy as np
import pytest
from support.commands import command

from ogm_mcmc.geometry import Pose2D, PoseBelief
from ogm_mcmc.io.trajectory_files import write_tum
from ogm_mcmc.io.tum_files import write_beliefs

STAMPS = [10**18 + k * 10**9 for k in range(5)]
TRUTH = [Pose2D(float(k), 0.0, 0.0) for k in range(5)]
# One pose a decimetre to the left, claimed to be sure to 5 cm; the fourth is turned.
OFF = [
    TRUTH[0],
    TRUTH[1],
    Pose2D(2.0, 0.1, 0.0),
    Pose2D(3.0, 0.0, 0.3),
    TRUTH[4],
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    covariance = np.diag(np.square([0.02, 0.04, 0.1]))
    beliefs = [PoseBelief(pose, covariance) for pose in OFF]
    write_beliefs(tmp_path / 'map_trajectory.txt', STAMPS, beliefs)
    # Half a millisecond late, in another order of rows than of poses, with one pose more.
    later = [stamp + 500_000 for stamp in STAMPS]
    write_tum(tmp_path / 'truth.txt', [*later, later[-1] + 10**9], [*TRUTH, Pose2D(9.0, 9.0)])
    (tmp_path / 'relations').write_text(
        '1000000001 1000000002 1 0 0 0 0 0\n1000000003 1000000004 1 0 0 0 0 0\n'
        '1000000000 1000000009 1 0 0 0 0 0\n'
    )
    return tmp_path


def test_errors_and_coverage(folder, capsys):
    code, out, _ = command(
        capsys, 'evaluate', '--estimate', 'map_trajectory.txt', '--true-trajectory', 'truth.txt',
        '--relations', 'relations', '--json',
    )  # fmt: skip
    assert code == 0
    found = json.loads(out)['poses']
    truth = found['truth']
    assert (found['poses'], truth['matched']) == (5, 5)
    # The middle pose is off by a decimetre: all move by a fifth of it, and nothing turns.
    assert truth['absolute']['max_m'] == pytest.approx(0.08, abs=1e-9)
    assert truth['absolute']['max_deg'] == pytest.approx(np.degrees(0.3))
    assert truth['relative']['max_m'] == pytest.approx(2.0 * np.sin(0.15))
    # 0.1 m is 2.5 deviations, 0.08 m 2.0 of them: either is too much for 95 %.
    assert truth['coverage'] == {'x': 1.0, 'y': 0.8, 'yaw': 0.8}
    assert truth['coverage_aligned'] == {'x': 1.0, 'y': 0.8, 'yaw': 0.8}
    relations = found['relations']
    assert relations['count'] == 2
    assert relations['mean_m'] == pytest.approx((0.1 + 2.0 * np.sin(0.15)) / 2.0, abs=1e-6)
    page = (folder / 'out' / 'evaluate' / 'evaluation.html').read_text()
    assert page.count('<img') == 2


def test_the_poses_beside_a_map_and_a_table(folder, capsys):
    code, out, _ = command(capsys, 'evaluate', 'map.npz', '--true-trajectory', 'truth.txt')
    assert code == 0
    assert '95 % intervals hold the truth x 1.000, y 0.800, yaw 0.800' in out


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (['--true-trajectory', 'truth.txt'], 'expected --estimate FILE'),
        (['--estimate', 'truth.txt'], 'expected --true-trajectory FILE'),
        (['--truth', 'truth.yaml'], 'no map: expected MAP'),
        (['map.npz', '--true-trajectory', 'relations'], 'line 1'),
        (['other.npz', '--true-trajectory', 'truth.txt'], 'other_trajectory.txt: cannot be read'),
        (
            ['map.npz', '--true-trajectory', 'truth.txt', '--stamp-tolerance', '1e-4'],
            '0 of 5 poses have a true one within 0.0001 s',
        ),
        (
            ['map.npz', '--relations', 'relations', '--stamp-tolerance', '-1'],
            '--stamp-tolerance is -1.0',
        ),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line(folder, capsys, options, reason):
    before = sorted(folder.rglob('*'))
    code, _, said = command(capsys, 'evaluate', *options)
    assert code == 2
    assert reason in said
    assert 'Traceback' not in said
    assert sorted(folder.rglob('*')) == before
