"""What was said of the robot's pose: interpolated, cut at jumps, never too long."""

import numpy as np
import pytest

from ogm_mcmc.engine.robot_track import RobotTrack
from ogm_mcmc.geometry import Pose2D

S = 1_000_000_000


def test_poses_between_and_at_stamps():
    track = RobotTrack()
    track.add(S, Pose2D(1.0, 2.0, 3.1))
    assert track.at(np.array([S])).tolist() == [[1.0, 2.0, pytest.approx(3.1)]]
    track.add(3 * S, Pose2D(3.0, 2.0, -3.1))
    between = track.at(np.array([S, 2 * S, 3 * S]))
    assert between[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert abs(between[1, 2]) == pytest.approx(np.pi, abs=1e-6)
    assert track.spans(np.array([S - 1, S, 3 * S, 3 * S + 1])).tolist() == [
        False,
        True,
        True,
        False,
    ]


def test_stamps_of_two_sensors_are_put_in_order():
    track = RobotTrack()
    for stamp in (10, 30, 20, 40):
        track.add(stamp, Pose2D(float(stamp)))
    assert track.stamps.tolist() == [10, 20, 30, 40]
    assert track.at(np.array([25]))[0, 0] == 25.0
    assert len(track) == 4


def test_a_bag_played_again_begins_a_new_track():
    track = RobotTrack()
    for stamp_s in (100, 101, 102, 5, 6):
        track.add(stamp_s * S, Pose2D())
    assert (track.stamps / S).tolist() == [5, 6]


def test_it_never_holds_more_than_asked():
    track = RobotTrack(most=1000)
    for k in range(10_000):
        track.add(k * S, Pose2D(float(k)))
        assert len(track) <= 1000
    asked = np.arange(0, 9999, 7) * S
    assert track.spans(asked).all()
    assert track.at(asked)[:, 0] == pytest.approx(asked / S)


def test_jumps_cut_it_into_pieces():
    track = RobotTrack()
    for k, x in enumerate((0.0, 0.1, 0.2, 0.5, 0.6, 0.6)):
        track.add(k * S // 10, Pose2D(x, 0.0, 1.0 if k == 5 else 0.0))
    pieces = track.pieces(track.stamps)
    assert pieces.tolist() == [0, 0, 0, 1, 1, 2]
