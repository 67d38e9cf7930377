"""The best trajectory of a particle filter: three particles on paper, and the recorded log."""

import itertools
import math

import numpy as np
import pytest

from ogm_mcmc.errors import LogError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.io.gmapping import best_trajectory


def gfs(*frames):
    """Each frame: (x, log-weight) of every particle, and the parents after it or None."""
    lines = []
    for k, (particles, parents) in enumerate(frames):
        ranges = ' '.join(['1.0'] * 180)
        lines.append(f'LASER_READING 180 {ranges} 0 0 0 {k + 1}.0')
        members = ' '.join(f'{x} 0 0 {weight}' for x, weight in particles)
        lines.append(f'SM_UPDATE {len(particles)} {members}')
        if parents is not None:
            lines.append(f'RESAMPLE {len(parents)} {" ".join(map(str, parents))}')
    return '\n'.join(lines) + '\n'


@pytest.fixture
def trajectory(tmp_path):
    def run(*frames):
        (tmp_path / 'a.gfs').write_text(gfs(*frames))
        return [pose.x_m for pose in best_trajectory(read_carmen(tmp_path / 'a.gfs').scans)]

    return run


def test_without_resampling_the_last_weights_decide(trajectory):
    frames = [([(0, -1), (10, -9)], None), ([(1, -20), (11, -12)], None)]
    assert trajectory(*frames) == [10, 11]


def test_weights_of_a_line_of_descent_add_up(trajectory):
    """The last weights favour particle 1, but its forebear 2 had lost far more."""
    frames = [
        ([(0, -50), (10, -1), (20, -30)], [1, 2, 1]),
        ([(1, -7), (11, -5), (21, -9)], None),
        ([(2, -12), (12, -6), (22, -14)], None),
    ]
    assert trajectory(*frames) == [10, 1, 2]


def test_resampling_twice(trajectory):
    frames = [
        ([(0, -1), (10, -1)], [1, 0]),
        ([(1, -1), (11, -1)], [1, 1]),
        ([(2, -3), (12, -2)], [0, 0]),
    ]
    # Parents after the last scan belong to a future that is not there.
    assert trajectory(*frames) == [0, 11, 12]


def test_a_log_without_particles(tmp_path):
    text = gfs(([(0, -1)], None))
    (tmp_path / 'a.gfs').write_text('\n'.join(text.splitlines()[:1]))
    with pytest.raises(LogError, match='line 1: a scan without SM_UPDATE'):
        best_trajectory(read_carmen(tmp_path / 'a.gfs').scans)


@pytest.mark.parametrize(
    ('line', 'message'),
    [
        ('RESAMPLE 2 0 2', 'line 3: RESAMPLE names others: expected 2 of the particles before'),
        ('RESAMPLE 3 0 0 1', 'line 3: RESAMPLE names others'),
        ('RESAMPLE 2 0', 'line 3: RESAMPLE line ends too early'),
        ('RESAMPLE 2 0 x', 'line 3: a range is no number'),
    ],
)
def test_resampling_that_makes_no_sense(tmp_path, line, message):
    """The scans stay; what descends from what is then unknown, and nobody guesses it."""
    frame = ([(0, -1), (1, -1)], None)
    damaged = gfs(frame) + line + '\n' + gfs(frame)
    (tmp_path / 'a.gfs').write_text(damaged)
    log = read_carmen(tmp_path / 'a.gfs')
    assert (len(log.scans), log.damaged) == (2, 1)
    assert log.first_damage.startswith(message)
    with pytest.raises(LogError, match='line 1: the RESAMPLE after it is damaged'):
        best_trajectory(log.scans)


def test_resampling_after_a_damaged_scan(tmp_path):
    frame = ([(0, -1), (1, -1)], None)
    later = gfs(([(0, -1), (1, -1)], [1, 0]))
    (tmp_path / 'a.gfs').write_text(gfs(frame) + later.replace(' 1.0 ', ' ? ', 1) + gfs(frame))
    log = read_carmen(tmp_path / 'a.gfs')
    assert len(log.scans) == 2
    with pytest.raises(LogError, match='line 1: the RESAMPLE after it is damaged'):
        best_trajectory(log.scans)


@pytest.mark.data
def test_the_recorded_trajectory_is_one_walk(data_folder):
    """Ancestors follow the odometry from scan to scan; the likeliest of each time jump about."""
    scans = read_carmen(data_folder / 'csail' / 'csail.corrected.gfs').scans
    best = best_trajectory(scans)
    likeliest = [Pose2D(*s.particles.poses[np.argmax(s.particles.weights)]) for s in scans]
    assert len(best) == 406
    assert sum(scan.parents is not None for scan in scans) == 47

    def steps(poses):
        between = [a.inverse().compose(b) for a, b in itertools.pairwise(poses)]
        return np.array([(step.x_m, step.y_m) for step in between])

    odometry = steps([scan.laser_pose for scan in scans])
    off, off_likeliest = (
        np.percentile(np.hypot(*(steps(poses) - odometry).T), 90) for poses in (best, likeliest)
    )
    assert off < 0.2 < off_likeliest
    assert math.hypot(best[-1].x_m - likeliest[-1].x_m, best[-1].y_m - likeliest[-1].y_m) < 0.2
