"""Joint poses from particles: which beams move what, and who is judged where."""

from dataclasses import replace

import numpy as np
import pytest
from support.rooms import noisy_drive

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.geometry import PoseBelief, PoseSamples, Scan
from ogm_mcmc.lab.experiments import joint_csail
from ogm_mcmc.lab.experiments.pose_particles import Believed
from ogm_mcmc.trajectory.points import poses_of, xyyaw

SETTINGS = TrajectoryConfig(draws=2)


@pytest.fixture
def believed() -> list[Believed]:
    """A drive; each belief has fifteen particles around where the localizer puts the scan."""
    truth, placed = noisy_drive()
    rng = np.random.default_rng(9)
    found = []
    for one, pose in zip(placed, poses_of(truth), strict=True):
        mean = one.belief.mean
        around = np.array([mean.x_m, mean.y_m, mean.yaw_rad])
        drawn = around + rng.normal(size=(15, 3)) * (0.06, 0.06, 0.03)
        particles = PoseSamples.checked(drawn)
        belief = PoseBelief(particles.mean(), None, particles)
        found.append(Believed(one._replace(belief=belief), pose))
    return found


def test_held_out_beams_move_no_pose_and_judge(believed: list[Believed]) -> None:
    refinement = joint_csail.refined(believed, SETTINGS)
    poses, beliefs = refinement.poses, refinement.beliefs()
    maps = joint_csail.maps_of(believed, beliefs)
    nats = {name: joint_csail.nats_of(believed, one) for name, one in maps.items()}
    assert nats[joint_csail.JOINT] > nats[joint_csail.MEAN] + 0.2
    assert nats[joint_csail.JOINT] > nats[joint_csail.LIKELIEST] + 0.2
    assert nats[joint_csail.WEIGHTED] > nats[joint_csail.ALL] + 0.05
    assert nats[joint_csail.SPREAD] > nats[joint_csail.MEAN] + 0.2
    assert maps[joint_csail.SPREAD].poses is maps[joint_csail.JOINT].poses
    areas = {name: joint_csail.area_of_points(believed, one) for name, one in maps.items()}
    assert 1.0 > areas[joint_csail.JOINT] > areas[joint_csail.MEAN] > 0.5
    for one in believed:
        one.placed.scan.ranges_m[2::4] = 1.0
        one.placed.scan.ranges_m[3::4] = 1.0
    again = joint_csail.refined(believed, replace(SETTINGS)).poses
    np.testing.assert_array_equal(again, poses)


def test_the_halves_of_a_scan_have_beams_of_both_turns_of_the_mirror() -> None:
    scan = Scan.checked(
        np.arange(1.0, 8.0),
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        range_min_m=0.0,
        range_max_m=9.0,
    )
    halves = [joint_csail.every_other_pair(scan, first) for first in (0, 1)]
    seen = [np.flatnonzero(np.isfinite(half.ranges_m)).tolist() for half in halves]
    assert seen == [[0, 1, 4, 5], [2, 3, 6]]
    for half, beams in zip(halves, seen, strict=True):
        np.testing.assert_array_equal(half.ranges_m[beams], scan.ranges_m[beams])


def test_the_benchmark_is_the_map_of_the_final_trajectory(believed: list[Believed]) -> None:
    known = [one.known for one in believed]
    maps = joint_csail.maps_of(believed, [PoseBelief(pose, None) for pose in known])
    rows, curves = joint_csail.by_benchmark(believed, maps)
    areas = {line['what']: line['ours'] for line in rows if 'ROC' in line['what']}
    joint = areas['joint: ROC area']
    assert joint == max(areas.values())  # put where the benchmark is
    assert [curve.label for curve in curves] == [n for n in maps if n != joint_csail.FINAL]
    # Where all poses are shifted, so is the benchmark that is moved, and only that.
    shifted = xyyaw(known) + np.array([0.4, -0.3, 0.0])
    elsewhere = joint_csail.Mapped(joint_csail.benchmark_at(believed, shifted), shifted)
    chosen = {joint_csail.FINAL: maps[joint_csail.FINAL], joint_csail.JOINT: elsewhere}
    rows, _ = joint_csail.by_benchmark(believed, chosen)
    areas = {line['what']: line['ours'] for line in rows if 'ROC' in line['what']}
    assert areas['joint: ROC area, moved'] > 0.999
    assert areas['joint: ROC area'] < 0.9
