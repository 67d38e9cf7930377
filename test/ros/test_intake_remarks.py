"""What the intake of scans says of what is missing or odd, and odd transforms."""

import math

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from support.local_ros import pose, scan

from ogm_mcmc.config import PlacingConfig
from ogm_mcmc.engine import transform_tree

pytestmark = [pytest.mark.ros]


def test_what_is_missing_for_a_pose_is_named(bench):
    taken = bench()
    taken.scan(1.0)
    taken.intake.pass_on()
    assert any(
        'no pose is known; /pose has 0 publishers' in line for line in taken.logs.of('warning')
    )


def test_what_is_missing_in_tf_is_named(tf_bench):
    taken = tf_bench(pose_source='tf')
    taken.tf(('odom', 'base_link', 1.0))
    taken.scan(1.0, frame='base_link')
    taken.intake.pass_on()
    (line,) = taken.logs.of('warning')
    assert "frame 'map' is not there; known: base_link, odom" in line
    assert '/tf has 0 publishers, /tf_static has 0' in line


def test_a_scan_of_which_no_beam_says_anything_is_not_used(bench):
    taken = bench()
    taken.intake.on_pose(pose(1.0))
    taken.scan(1.0, [math.nan, 0.01, 9.0, -math.inf])
    assert taken.used == []
    assert taken.problems == {'scan_says_nothing': 1}
    taken.scan(1.0, [math.nan, 1.0, math.inf])
    assert len(taken.used) == 1
    values = taken.intake.values()
    assert (values['beams used'], values['beams ignored']) == (2, 5)


def test_odd_scans_are_remarked_once(bench):
    taken = bench()
    taken.intake.on_pose(pose(1.0))
    taken.intake.on_pose(pose(3.0))
    for k in range(3):
        odd = scan(1.0 + 0.1 * k, [1.0, 2.0, 3.0])
        odd.angle_max = 0.0
        taken.intake.on_scan(odd)
    assert len(taken.used) == 3
    assert len([line for line in taken.logs.of('warning') if 'angles' in line]) == 1


def test_poses_that_come_rarely_are_a_reason_to_use_tf(bench):
    taken = bench()
    for k in range(10):
        taken.intake.on_pose(pose(1.5 * k, x=0.25 * k))
    assert [line for line in taken.logs.of('warning') if 'set pose_source to tf' in line] == [
        'poses come every 1.5 s, and the robot moves 0.25 m between them: scans are placed on the '
        'straight way from one to the next; with a localizer that publishes tf (amcl, '
        'slam_toolbox) set pose_source to tf'
    ]


def test_a_correction_of_the_past_is_a_warning(tf_bench):
    taken = tf_bench(pose_source='tf')
    for time_s, x in ((1.0, 0.0), (1.1, 0.05), (1.2, 0.85)):
        taken.tf(('map', 'odom', time_s, x), ('odom', 'base_link', time_s, 3.0))
    assert taken.problems == {'map_corrected': 1}
    (line,) = taken.logs.of('warning')
    assert line.startswith('map -> odom moved the robot by 0.80 m and 0.0 degrees at once')


def test_one_transform_from_the_far_future_does_not_end_the_mapping(tf_bench):
    """The others of its frame are older than it and would be dropped for ever."""
    taken = tf_bench(pose_source='tf')
    taken.tf(('map', 'odom', 2e9))
    for k in range(30):
        time_s = 1.0 + 0.1 * k
        taken.tf(('map', 'odom', time_s), ('odom', 'base_link', time_s))
        taken.scan(time_s, frame='base_link')
    assert len(taken.used) > 15


def test_transforms_that_are_none_are_counted(tf_bench):
    taken = tf_bench()
    taken.tf(('map', 'map', 1.0), ('map', 'odom', 1.0, math.nan), ('odom', 'base_link', 1.0))
    assert taken.problems == {'tf_invalid': 2}


def test_frames_that_somebody_makes_up_do_not_fill_the_memory(tf_bench, monkeypatch):
    monkeypatch.setattr(transform_tree, 'MAX_LIVE_FRAMES', 3)
    taken = tf_bench()
    taken.tf_static(('base_link', 'laser', 0))
    for k in range(10):
        taken.tf(('map', f'thing_{k}', 1.0), ('map', 'base_link', 1.0 + k))
    assert taken.intake.transforms.tree.frames() == ['base_link', 'laser', 'map', 'thing_0']
    assert taken.problems == {'tf_invalid': 9}


def test_tf_that_starts_again_is_followed(tf_bench):
    taken = tf_bench(pose_source='tf')
    for start_s in (1000.0, 1.0):
        for k in range(20):
            taken.tf(('map', 'base_link', start_s + 0.1 * k, 1.0))
            taken.scan(start_s + 0.1 * k, frame='base_link')
    assert len(taken.used) > 25


def test_a_code_below_range_max_is_no_return_and_said_once(bench):
    taken = bench(placing=PlacingConfig(no_return_code=0.0))
    taken.intake.on_pose(pose(1.0))
    taken.intake.on_pose(pose(3.0))
    ranges = [*(1.0 + 0.1 * k for k in range(12)), *[4.99] * 12]
    for k in range(3):
        odd = scan(1.0 + 0.1 * k, ranges)
        odd.angle_increment, odd.angle_max = 0.1, 2.3
        taken.intake.on_scan(odd)
    assert all((one.scan.ranges_m[12:] == math.inf).all() for one in taken.used)
    (line,) = [line for line in taken.logs.of('info') if 'no return' in line]
    assert line.startswith('laser: readings of 4.99 m (50% of them)')
    taken.intake.configure(taken.intake.settings, PlacingConfig(no_return_code=5.0))
    taken.intake.on_scan(odd)
    assert taken.intake.codes.taken(taken.used[0].scan).ranges_m[0] == 1.0
