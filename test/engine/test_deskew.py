import math

import numpy as np
import pytest

from ogm_mcmc.engine.deskew import MAX_TURN_RAD, MAX_WAY_M, deskewed, last_stamp_ns
from ogm_mcmc.engine.placing import PoseHistory, Waiting
from ogm_mcmc.geometry import Pose2D, PoseBelief, Scan

S = 1_000_000_000
START = 1_700_000_000 * S
BEAMS = 720
INCREMENT = 2 * math.pi / BEAMS
BEAM_S = 0.1 / BEAMS

# A room of 8 m x 6 m around the origin.
HALF_SIDES = (4.0, 3.0)


def wall_ahead(pose, bearing):
    """How far it is to the wall of the room, by the sides of the box."""
    ux, uy = math.cos(pose.yaw_rad + bearing), math.sin(pose.yaw_rad + bearing)
    ways = []
    for place, unit, side in zip((pose.x_m, pose.y_m), (ux, uy), HALF_SIDES, strict=True):
        if unit:
            ways.append((math.copysign(side, unit) - place) / unit)
    return min(ways)


def motion(speed=0.0, turn=0.0):
    """The pose and belief of a robot on a circle (or a line) at each stamp."""

    def at(stamp_ns):
        t = (stamp_ns - START) / 1e9
        if turn == 0.0:
            return PoseBelief(Pose2D(0.3 + speed * t, -0.2, 0.4))
        radius, yaw = speed / turn, 0.4 + turn * t
        x = 0.3 + radius * (math.sin(yaw) - math.sin(0.4))
        y = -0.2 - radius * (math.cos(yaw) - math.cos(0.4))
        return PoseBelief(Pose2D(x, y, math.remainder(yaw, 2 * math.pi)))

    return at


def skewed_scan(belief_at, increment=INCREMENT):
    ranges = [
        wall_ahead(belief_at(START + round(i * BEAM_S * 1e9)).mean, -3.0 + i * increment)
        for i in range(BEAMS)
    ]
    return Scan.checked(
        np.array(ranges, np.float32),
        angle_min_rad=-3.0,
        angle_increment_rad=increment,
        range_min_m=0.1,
        range_max_m=20.0,
        stamp_ns=START,
        frame_id='laser',
    )


def off_the_wall(placed):
    """How far the ends of the beams are from the nearest wall, m."""
    off = []
    for scan, belief in placed:
        ahead, left = scan.directions() * scan.ranges_m
        pose = belief.mean
        x = pose.x_m + math.cos(pose.yaw_rad) * ahead - math.sin(pose.yaw_rad) * left
        y = pose.y_m + math.sin(pose.yaw_rad) * ahead + math.cos(pose.yaw_rad) * left
        to_x, to_y = np.abs(x) - HALF_SIDES[0], np.abs(y) - HALF_SIDES[1]
        inside = np.minimum(np.abs(to_x), np.abs(to_y))
        # Past a corner both coordinates are out.
        off.append(np.where((to_x > 0) & (to_y > 0), np.hypot(to_x, to_y), inside))
    return np.concatenate(off)


@pytest.mark.parametrize('increment', [INCREMENT, -INCREMENT])
@pytest.mark.parametrize(
    ('speed', 'turn'), [(0.0, math.radians(60)), (0.0, -2.0), (1.5, 0.0), (1.0, 1.5)]
)
def test_a_robot_on_the_move_sees_straight_walls(speed, turn, increment):
    belief_at = motion(speed, turn)
    scan = skewed_scan(belief_at, increment)
    pieces = deskewed(scan, BEAM_S, belief_at)
    furthest = float(scan.ranges_m.max())
    bound = furthest * MAX_TURN_RAD / 2 + MAX_WAY_M / 2
    assert off_the_wall(pieces).max() < bound
    assert off_the_wall([(scan, belief_at(START))]).max() > 4 * bound


def test_a_scan_is_cut_as_finely_as_the_turn_asks_for():
    belief_at = motion(turn=math.radians(60))
    scan = skewed_scan(belief_at)
    pieces = deskewed(scan, BEAM_S, belief_at)
    assert len(pieces) == 24  # of a quarter degree each
    assert {piece.ranges_m.size for piece, _ in pieces} == {30}


def test_the_pieces_are_the_scan():
    belief_at = motion(1.0, 1.5)
    scan = skewed_scan(belief_at)
    pieces = deskewed(scan, BEAM_S, belief_at)
    assert np.array_equal(np.concatenate([piece.ranges_m for piece, _ in pieces]), scan.ranges_m)
    directions = np.concatenate([piece.directions() for piece, _ in pieces], axis=1)
    np.testing.assert_allclose(directions, scan.directions(), atol=1e-12)
    stamps = [piece.stamp_ns for piece, _ in pieces]
    assert stamps == sorted(stamps)
    assert [belief for _, belief in pieces] == [belief_at(stamp) for stamp in stamps]
    assert scan.stamp_ns < stamps[0]
    assert stamps[-1] < last_stamp_ns(scan, BEAM_S) == START + round(719 * BEAM_S * 1e9)
    assert {piece.frame_id for piece, _ in pieces} == {'laser'}


def test_a_robot_that_stands_still_keeps_the_whole_scan():
    belief_at = motion()
    ((piece, belief),) = deskewed(skewed_scan(belief_at), BEAM_S, belief_at)
    assert piece.ranges_m.size == BEAMS
    assert belief == belief_at(START)


def test_a_scan_taken_at_once_comes_back_as_it_is():
    belief_at = motion(turn=3.0)
    scan = skewed_scan(belief_at)
    ((whole, belief),) = deskewed(scan, 0.0, belief_at)
    assert whole is scan
    assert belief == belief_at(START)


def test_never_more_pieces_than_beams():
    belief_at = motion(turn=3.0)
    pieces = deskewed(skewed_scan(belief_at), BEAM_S, belief_at, max_turn_rad=1e-9)
    assert [piece.ranges_m.size for piece, _ in pieces] == [1] * BEAMS


def test_the_last_beam_waits_for_its_pose():
    belief_at = motion(turn=1.0)
    history = PoseHistory()
    scan = skewed_scan(belief_at)
    for k in range(2):
        history.add(START + k * S // 20, belief_at(START + k * S // 20))
    with pytest.raises(Waiting):
        deskewed(scan, BEAM_S, history.at)
    history.add(START + S // 10, belief_at(START + S // 10))
    assert len(deskewed(scan, BEAM_S, history.at)) == 23
