"""Joint poses from particles: which beams move what, and who is judged where."""

from dataclasses import replace

import numpy as np
import pytest
from support.rooms import noisy_drive

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.geometry import PoseBelief, PoseSamples
from ogm_mcmc.lab.experiments import joint_csail
from ogm_mcmc.lab.experiments.pose_particles import Believed
from ogm_mcmc.trajectory.points import poses_of

SETTINGS = TrajectoryConfig(draws=2)


@pytest.fixture
def believed() -> list[Believed]:
    """A drive; each belief has thirty particles around where the localizer puts the scan."""
    truth, placed = noisy_drive()
    rng = np.random.default_rng(9)
    found = []
    for one, pose in zip(placed, poses_of(truth), strict=True):
        mean = one.belief.mean
        around = np.array([mean.x_m, mean.y_m, mean.yaw_rad])
        drawn = around + rng.normal(size=(30, 3)) * (0.06, 0.06, 0.03)
        particles = PoseSamples.checked(drawn)
        belief = PoseBelief(particles.mean(), None, particles)
        found.append(Believed(one._replace(belief=belief), pose))
    return found


def test_odd_beams_move_no_pose_and_judge(believed: list[Believed]) -> None:
    poses = joint_csail.refined(believed, SETTINGS).poses
    maps = joint_csail.maps_of(believed, poses)
    nats = {name: joint_csail.nats_of(believed, one) for name, one in maps.items()}
    assert nats[joint_csail.JOINT] > nats[joint_csail.MEAN] + 0.2
    assert nats[joint_csail.JOINT] > nats[joint_csail.LIKELIEST] + 0.2
    assert nats[joint_csail.WEIGHTED] > nats[joint_csail.ALL] + 0.05
    areas = {name: joint_csail.area_of_points(believed, one) for name, one in maps.items()}
    assert 1.0 > areas[joint_csail.JOINT] > areas[joint_csail.MEAN] > 0.5
    for one in believed:
        one.placed.scan.ranges_m[1::2] = 1.0
    again = joint_csail.refined(believed, replace(SETTINGS)).poses
    np.testing.assert_array_equal(again, poses)


def test_the_benchmark_is_the_map_of_the_final_trajectory(believed: list[Believed]) -> None:
    poses = np.array([(p.x_m, p.y_m, p.yaw_rad) for p in (one.known for one in believed)])
    maps = joint_csail.maps_of(believed, poses)
    rows, curves = joint_csail.by_benchmark(believed, maps)
    areas = {line['what']: line['ours'] for line in rows if 'ROC' in line['what']}
    assert max(areas, key=areas.__getitem__) == 'joint: ROC area'  # put where the benchmark is
    assert [curve.label for curve in curves] == [n for n in maps if n != joint_csail.FINAL]
