"""Between poses of a trajectory file the robot goes as it was recorded to."""

import math

import numpy as np
import pytest

from ogm_mcmc.engine.corrections import Nodes
from ogm_mcmc.engine.recorded_motion import seldom, track_of, with_recorded_motion

STEP_NS = 100_000_000
STAMPS = np.arange(81, dtype=np.int64) * STEP_NS


def way():
    """Five steps ahead, five on the spot to the left, and so on: (81, 3)."""
    poses = np.zeros((STAMPS.size, 3))
    for k in range(1, STAMPS.size):
        x, y, yaw = poses[k - 1]
        turns = (k - 1) % 10 >= 5
        ahead, turn = (0.0, 0.1 * math.pi) if turns else (0.2, 0.0)
        poses[k] = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw), yaw + turn
    return poses


def seen_from(origin, poses):
    """Return poses as somebody has them whose origin lies elsewhere."""
    x, y, yaw = origin
    cosine, sine = math.cos(yaw), math.sin(yaw)
    x_there = x + cosine * poses[:, 0] - sine * poses[:, 1]
    y_there = y + sine * poses[:, 0] + cosine * poses[:, 1]
    return np.stack((x_there, y_there, yaw + poses[:, 2]), axis=1)


@pytest.mark.parametrize('every', [7, 10, 40])
def test_a_robot_that_turns_between_two_poses_is_where_it_was(every):
    true, odometry = way(), seen_from((3.0, -2.0, 1.0), way())
    nodes = Nodes(STAMPS[::every], true[::every])
    filled = with_recorded_motion(nodes, track_of(STAMPS, odometry))
    last = (STAMPS.size - 1) // every * every
    assert filled.stamps_ns.tolist() == STAMPS[: last + 1].tolist()
    assert filled.poses[:, :2] == pytest.approx(true[: last + 1, :2], abs=1e-9)
    turned = np.exp(1j * (filled.poses[:, 2] - true[: last + 1, 2]))
    assert turned == pytest.approx(np.ones(last + 1), abs=1e-9)
    assert np.array_equal(filled.poses[::every], nodes.poses)


def test_poses_before_and_after_all_recorded_ones_stay():
    true = way()
    nodes = Nodes(STAMPS[::10], true[::10])
    recorded = track_of(STAMPS[15:48], true[15:48])
    filled = with_recorded_motion(nodes, recorded)
    expected = sorted({*STAMPS[::10].tolist(), *STAMPS[20:41].tolist()})
    assert filled.stamps_ns.tolist() == expected


def test_what_another_robot_did_is_of_no_use():
    true = way()
    other = np.cumsum(np.random.default_rng(1).normal(0.0, 0.5, true.shape), axis=0)
    nodes = Nodes(STAMPS[::5], true[::5])
    assert with_recorded_motion(nodes, track_of(STAMPS, other)) is None
    # Nor a clock that is two turns late, nor what says nothing.
    assert with_recorded_motion(nodes, track_of(STAMPS + 25 * STEP_NS, true)) is None
    assert with_recorded_motion(nodes, track_of(STAMPS[:1], true[:1])) is None
    assert with_recorded_motion(nodes, track_of(STAMPS + 10**12, true)) is None


def test_where_the_file_went_another_way_or_was_silent_for_long_nothing_is_filled_in():
    true, at = way(), [0, 10, 20, 30, 60, 70]
    nodes = Nodes(STAMPS[at], true[at].copy())
    nodes.poses[3:, 0] += 0.2  # in a second of 1 m: as wheels err
    recorded = track_of(STAMPS, true)
    assert np.isin(STAMPS[:71], with_recorded_motion(nodes, recorded).stamps_ns).all()
    filled = with_recorded_motion(nodes, recorded, longest_s=2.9)
    assert filled.stamps_ns.tolist() == [*STAMPS[:31].tolist(), *STAMPS[60:71].tolist()]
    nodes.poses[3:, 0] += 0.3  # carried
    filled = with_recorded_motion(nodes, recorded)
    assert filled.stamps_ns.tolist() == [*STAMPS[:21].tolist(), *STAMPS[30:71].tolist()]
    nodes.poses[2:4, 0] = true[[20, 30], 0]
    nodes.poses[5, 2] += 1.2  # turned by hand: 0.58 more than wheels err
    assert (
        with_recorded_motion(nodes, recorded).stamps_ns.tolist()[-2:] == STAMPS[[60, 70]].tolist()
    )


def test_two_poses_and_no_more_go_with_what_was_recorded():
    true = way()
    filled = with_recorded_motion(Nodes(STAMPS[[0, 8]], true[[0, 8]]), track_of(STAMPS, true))
    assert filled.poses == pytest.approx(true[:9], abs=1e-9)


def test_wheels_that_tell_a_thousand_poses_a_second_are_looked_at_fifty_times():
    stamps = 7 * 10**9 + np.arange(1000, dtype=np.int64) * 1_000_000
    assert np.array_equal(seldom(stamps[::-1]), stamps[::20])
    assert np.array_equal(seldom(STAMPS), STAMPS)
    assert seldom(STAMPS[:0]).size == 0
