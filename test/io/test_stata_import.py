"""A synthetic PR2 bag and pose file of exactly the documented shape, and what becomes of them.

The robot walks through the simulated office. Its laser, 0.275 m ahead of the base, has 1040 beams
0.25 degrees apart; the pose file has the laser's poses in microseconds at half the scan rate.
"""

import math

import numpy as np
import pytest
from support.stata_files import (
    SCAN_US,
    START_US,
    laser_poses,
    write_poses,
    write_pr2,
)

from ogm_mcmc.cli.main import run
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.bag_scans import PlacedScans, StreamChoice, choose_topics
from ogm_mcmc.errors import BagError, ConfigError, LogError, OutputError
from ogm_mcmc.evaluation import aligned, distance_to
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.stata_import import StataOptions, TimedPose, import_stata, read_pose_file
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.simulation import WORLDS, rasterised, walk

EXCERPT = """\
1327678621454971,29.3921,130.493,0.538698
1327678621504968,29.3935,130.493,0.538698
1327678621554966,29.3937,130.492,0.538539
1327678633037916,29.3067,130.571,1.02759
1327678640007882,28.7215,132.092,1.69557
"""


@pytest.fixture(scope='module')
def bases():
    """Base poses of 12 s of a walk, one every 25 ms."""
    building = WORLDS['office']()
    poses = walk(building.waypoints, period_s=0.025, speed_m_s=0.8, turn_rad_s=1.2)
    return [pose for pose, _ in zip(poses, range(480), strict=False)]


@pytest.fixture
def pr2(bases, tmp_path):
    """The bag (every eighth scan only, to be quick) and the poses of the laser."""
    write_pr2(tmp_path / 'pr2.bag', WORLDS['office']().walls, bases, scan_every=8)
    return tmp_path / 'pr2.bag', laser_poses(bases)


@pytest.fixture
def poses_file(tmp_path):
    """Write a pose file."""

    def write(poses, shift_us=0):
        write_poses(tmp_path / 'poses', poses, shift_us)
        return tmp_path / 'poses'

    return write


def mapped(bag_path):
    pipeline = MappingPipeline(MapperConfig(resolution=0.05))
    with BagReader(bag_path) as bag:
        choice = StreamChoice()
        for scan, belief in PlacedScans(bag, choose_topics(bag, choice), choice):
            pipeline.update(PlacedScan(scan, belief))
    return pipeline.map()


def wall_error_m(bag_path):
    """95 % of the drawn walls are nearer than this to a true one."""
    truth = rasterised(WORLDS['office'](), 0.05)
    drawn = aligned(mapped(bag_path), truth) > 0.5
    return 0.05 * float(np.percentile(distance_to(truth.probability == 1.0)[drawn], 95.0))


def test_the_excerpt(tmp_path):
    (tmp_path / 'real.gt.laser.poses').write_text(EXCERPT)
    poses = read_pose_file(tmp_path / 'real.gt.laser.poses')
    assert len(poses) == 5
    assert poses[0] == TimedPose(1_327_678_621_454_971_000, Pose2D(29.3921, 130.493, 0.538698))


def test_scans_poses_and_odometry_arrive(pr2, poses_file, tmp_path, read_bag):
    bag, laser = pr2
    csv = poses_file(laser)
    summary = import_stata(bag, csv, tmp_path / 'out')
    # The last pose is of scan 478; scans 0, 8, ..., 472 lie before it.
    assert (summary.poses, summary.scans, summary.odometry) == (240, 60, 120)
    held = read_bag(tmp_path / 'out')
    assert {name: len(kept) for name, kept in held.topics.items()} == {
        '/pose': 240, '/scan': 60, '/odom': 120,
    }  # fmt: skip
    assert held.order == sorted(held.order, key=lambda item: item[0])
    stamp, scan = held.topics['/scan'][1]
    assert stamp == 1000 * (START_US + 8 * SCAN_US)
    assert scan.ranges.size == 1040
    assert scan.angle_max - scan.angle_min == pytest.approx(math.radians(259.75), abs=1e-5)
    assert (scan.header.frame_id, scan.range_max) == ('base_laser_link', 30.0)
    _, odom = held.topics['/odom'][0]
    assert odom.twist.twist.linear.x == 0.8
    _, pose = held.topics['/pose'][7]
    assert pose.pose.pose.position.x == pytest.approx(laser[7].x_m, abs=1e-4)


def test_the_map_is_the_building(pr2, poses_file, tmp_path):
    bag, laser = pr2
    import_stata(bag, poses_file(laser), tmp_path / 'out')
    right = wall_error_m(tmp_path / 'out')
    assert right <= 0.051
    # The offset matters: taken for poses of the base, they put walls elsewhere.
    wrong = StataOptions(offset_x_m=0.275)
    import_stata(bag, tmp_path / 'poses', tmp_path / 'wrong', wrong)
    assert wall_error_m(tmp_path / 'wrong') > 2.0 * right


def test_offsets_in_time_and_along_the_heading(pr2, poses_file, bases, tmp_path):
    """Poses of the base, 82.2 s early: both offsets together put everything right."""
    bag, _ = pr2
    csv = poses_file(bases[::2], shift_us=-82_200_000)
    with pytest.raises(BagError, match=r'no scan on /base_scan between two poses .*time-offset'):
        import_stata(bag, csv, tmp_path / 'out')
    assert not (tmp_path / 'out').exists()
    both = StataOptions(time_offset_s=82.2, offset_x_m=0.275)
    assert import_stata(bag, csv, tmp_path / 'out', both).scans == 60
    assert wall_error_m(tmp_path / 'out') <= 0.051
    late = StataOptions(time_offset_s=82.7, offset_x_m=0.275)
    import_stata(bag, csv, tmp_path / 'late', late)
    assert wall_error_m(tmp_path / 'late') > 0.1


def test_gaps_repeats_and_disorder_are_counted(pr2, poses_file, tmp_path):
    bag, laser = pr2
    csv = poses_file(laser)
    lines = csv.read_text().splitlines(keepends=True)
    # 10 to 29 missing (1 s), one pose twice, two swapped, a blank line.
    kept = [*lines[4:10], *lines[30:60], lines[59], lines[61], lines[60], '\n', *lines[62:200]]
    csv.write_text(''.join(kept))
    summary = import_stata(bag, csv, tmp_path / 'out')
    assert (summary.poses_repeated, summary.poses_out_of_order) == (1, 1)
    # Scans 0; 24, 32, ..., 56 (between poses of scans 18 and 60); those after scan 398.
    assert summary.scans_before_first_pose == 1
    assert summary.scans_in_gaps == 5
    assert summary.scans_after_last_pose == 10
    assert summary.scans == 60 - 16


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        ('', 'expected at least two'),
        ('1,2,3,4\n', '1 poses'),
        ('1,2,3,4\n2,3,4\n', 'line 2: .*3 fields'),
        ('1,2,3,4\n\n2.5,3,4,5\n', 'line 3'),
        ('1,2,3,4\n2,nan,4,5\n', 'line 2: .*finite'),
        ('stamp,x,y,yaw\n', 'line 1'),
        ('1,2,3,4\n9999999999999999999,3,4,5\n', 'ROS stamp'),
    ],
)
def test_pose_files_that_are_none(pr2, tmp_path, content, reason):
    (tmp_path / 'poses').write_text(content)
    with pytest.raises(LogError, match=reason):
        import_stata(pr2[0], tmp_path / 'poses', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


def test_other_mistakes(pr2, poses_file, tmp_path):
    bag, laser = pr2
    csv = poses_file(laser)
    with pytest.raises(BagError, match='/tilt_scan'):
        import_stata(bag, csv, tmp_path / 'out', StataOptions(scan_topic='/tilt_scan'))
    with pytest.raises(BagError, match='has type nav_msgs'):
        import_stata(bag, csv, tmp_path / 'out', StataOptions(scan_topic='/base_odometry/odom'))
    with pytest.raises(LogError, match='expected a readable pose file'):
        import_stata(bag, tmp_path / 'nowhere', tmp_path / 'out')
    (tmp_path / 'out').mkdir()
    with pytest.raises(OutputError, match='exists and is no rosbag2; expected a new name'):
        import_stata(bag, csv, tmp_path / 'out')
    for wrong in ({'time_offset_s': math.nan}, {'max_pose_gap_s': 0.0}):
        with pytest.raises(ConfigError):
            StataOptions(**wrong)


def test_the_command(pr2, poses_file, tmp_path, capsys):
    bag, laser = pr2
    csv = poses_file(laser)
    arguments = ['import-stata', str(bag), '--poses', str(csv), '-o', str(tmp_path / 'out')]
    assert run(arguments) == 0
    assert 'scans      60 (left out: 0 before' in capsys.readouterr().out
    assert run(arguments) == 2
    assert 'exists already' in capsys.readouterr().err
    assert run([*arguments, '--overwrite', '--json', '--max-pose-gap', '0.01']) == 0
    # With no two poses near enough, only scans with a pose of their own stamp are left.
    assert '"scans": 60' in capsys.readouterr().out
