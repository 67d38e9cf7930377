import math

import numpy as np
import pytest

from ogm_mcmc.engine.deskew import bent, last_stamp_ns, time_between_beams
from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory
from ogm_mcmc.geometry import Pose2D, PoseBelief, Scan, SensorMount

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


def skewed_scan(belief_at, increment=INCREMENT, **fields):
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
        frame_id='laser',
        **{'stamp_ns': START, 'time_increment_s': BEAM_S, **fields},
    )


def off_the_wall(placed):
    """How far the ends of the beams are from the nearest wall, m."""
    ahead, left = placed.scan.directions() * placed.scan.ranges_m
    pose = placed.pose
    x = pose.x_m + math.cos(pose.yaw_rad) * ahead - math.sin(pose.yaw_rad) * left
    y = pose.y_m + math.sin(pose.yaw_rad) * ahead + math.cos(pose.yaw_rad) * left
    to_x, to_y = np.abs(x) - HALF_SIDES[0], np.abs(y) - HALF_SIDES[1]
    # Past a corner both coordinates are out.
    out = np.hypot(np.maximum(to_x, 0.0), np.maximum(to_y, 0.0))
    return np.where((to_x > 0) & (to_y > 0), out, np.minimum(np.abs(to_x), np.abs(to_y)))


def placed_by(scan, belief_at, deskew, mount=None, every_s=0.05, last_s=0.2):
    """Place a scan by poses that come every so often."""
    placer = ScanPlacer(PoseHistory(), deskew=deskew)
    placer.add_scan(scan)
    for k in range(round(last_s / every_s) + 1):
        stamp_ns = START + round(k * every_s * 1e9)
        placer.add_pose(stamp_ns, belief_at(stamp_ns))
    (taken,) = placer.placed()
    return taken.on_mount(mount or SensorMount())


@pytest.mark.parametrize('increment', [INCREMENT, -INCREMENT])
@pytest.mark.parametrize(
    ('speed', 'turn'), [(0.0, math.radians(60)), (0.0, -2.0), (1.5, 0.0), (1.0, 1.5)]
)
def test_a_robot_on_the_move_sees_straight_walls(speed, turn, increment):
    belief_at = motion(speed, turn)
    scan = skewed_scan(belief_at, increment)
    assert off_the_wall(placed_by(scan, belief_at, 'auto')).max() < 0.005
    assert off_the_wall(placed_by(scan, belief_at, 'off')).max() > 0.1


@pytest.mark.parametrize('upside_down', [False, True])
def test_a_sensor_at_the_side_of_the_robot(upside_down):
    """It moves otherwise than the robot does: sideways while that turns on the spot."""
    robot, mount = motion(0.4, 2.0), SensorMount(Pose2D(0.5, -0.2, 1.8), upside_down)

    def sensor_at(stamp_ns):
        return PoseBelief(robot(stamp_ns).mean.compose(mount.pose))

    scan = skewed_scan(sensor_at)
    if upside_down:
        scan = scan.flipped()
    assert off_the_wall(placed_by(scan, robot, 'auto', mount)).max() < 0.005
    assert off_the_wall(placed_by(scan, robot, 'off', mount)).max() > 0.1


def test_readings_that_are_none_stay_what_they_are():
    ranges = [math.inf, math.nan, 0.01, 5.0, 19.99, -math.inf, 30.0]
    scan = Scan.checked(
        np.array(ranges),
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        range_min_m=0.1,
        range_max_m=20.0,
    )
    moved = bent(scan, Pose2D(0.3, 0.0, 0.6))
    kept = [0, 1, 2, 5, 6]
    assert np.array_equal(moved.ranges_m[kept], scan.ranges_m[kept], equal_nan=True)
    assert moved.ranges_m.dtype == np.float32
    assert moved.ranges_m[3] == pytest.approx(
        math.hypot(0.15 + 5.0 * math.cos(0.6), 5.0 * math.sin(0.6)), rel=1e-6
    )
    assert moved.ranges_m[4] == 20.0  # seen from the first place it is a little further
    # A beam that met nothing points at where it ends.
    assert moved.bearings()[0] == 0.0


def test_a_range_of_zero_does_not_become_a_wall():
    scan = Scan.checked(
        np.array([1.0, 0.0]),
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        range_min_m=0.0,
        range_max_m=20.0,
    )
    assert bent(scan, Pose2D(0.3, 0.0, 0.6)).ranges_m[1] == 0.0


def test_a_beam_without_limits_keeps_its_direction_in_the_room():
    scan = Scan.checked(
        np.full(3, np.inf),
        angle_min_rad=-0.5,
        angle_increment_rad=0.5,
        range_min_m=0.1,
        range_max_m=math.inf,
    )
    assert bent(scan, Pose2D(0.2, 0.1, 0.4)).bearings() == pytest.approx([-0.5, 0.2, 0.9])


def test_a_robot_that_stands_still_keeps_its_scan():
    belief_at = motion()
    scan = skewed_scan(belief_at)
    placed = placed_by(scan, belief_at, 'auto')
    assert placed.scan is scan
    assert placed.belief == belief_at(START)


@pytest.mark.parametrize(
    ('times', 'auto', 'on'),
    [
        ((0.0, 0.0), 0.0, 0.0),
        ((1e-4, 0.0), 1e-4, 1e-4),
        ((1e-4, 0.1), 1e-4, 1e-4),
        ((0.0, 0.1), 0.0, 0.1 / 720),  # simulators name it for scans taken at once
        ((1e-3, 0.1), 0.0, 1e-3),  # 0.7 s for a sweep that takes 0.1 s
    ],
)
def test_which_times_are_believed(times, auto, on):
    scan = skewed_scan(motion(), time_increment_s=times[0], scan_time_s=times[1])
    assert time_between_beams(scan, 'auto') == auto
    assert time_between_beams(scan, 'on') == pytest.approx(on)
    assert time_between_beams(scan, 'off') == 0.0


def test_the_last_beam_waits_for_its_pose_but_not_for_ever():
    belief_at = motion(turn=1.0)
    scan = skewed_scan(belief_at)
    assert last_stamp_ns(scan, BEAM_S) == START + round(719 * BEAM_S * 1e9)
    placer = ScanPlacer(PoseHistory(), deskew='auto', timeout_s=1.0)
    placer.add_scan(scan, now_s=0.0)
    for k in range(2):
        placer.add_pose(START + k * S // 20, belief_at(START + k * S // 20), now_s=0.0)
    assert list(placer.placed(0.5)) == []
    (taken,) = placer.placed(1.5)
    assert taken.way is None
    assert not placer.dropped
    placer.add_scan(skewed_scan(belief_at, stamp_ns=START + 1), now_s=2.0)
    placer.add_pose(START + S // 5, belief_at(START + S // 5), now_s=2.0)
    (taken,) = placer.placed(2.0)
    assert taken.way.yaw_rad == pytest.approx(719 * BEAM_S, rel=1e-6)


def test_no_beam_is_bent_over_a_jump():
    placer = ScanPlacer(PoseHistory(), deskew='auto')
    placer.add_scan(skewed_scan(motion()))
    for k, x in enumerate((0.0, 0.0, 5.0, 5.0)):
        placer.add_pose(START + k * S // 20, PoseBelief(Pose2D(x)))
    placer.add_pose(START + S // 5, PoseBelief(Pose2D(5.0)))
    (taken,) = placer.placed()
    assert taken.way is None
