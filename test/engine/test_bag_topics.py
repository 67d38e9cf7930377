"""Which scans and poses of a bag are used, and what is said of the others."""

import numpy as np
import pytest
from support.transforms import transform

from ogm_mcmc.config import MountConfig
from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.bag_survey import transform_topics
from ogm_mcmc.engine.bag_topics import choose_topics
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader, BagTopic

SECOND = 1_000_000_000
STAMPS = [20 * SECOND + k * SECOND // 10 for k in range(8)]
SLOW = [20 * SECOND + k * SECOND // 5 for k in range(8)]
NUMBERED = list(enumerate(STAMPS))


@pytest.fixture
def choose(write_bag):
    """Write records and choose: (topics, placed scans, lines said)."""

    def run(records, kind='mcap', **choice):
        said = []
        wanted = StreamChoice(**choice)
        with BagReader(write_bag(records, kind)) as bag:
            topics = choose_topics(bag, wanted)
            scans = PlacedScans(bag, topics, wanted, tell=said.append)
            placed = list(scans)
        return topics, placed, said

    return run


def odometry(prefix='', stamps=STAMPS, speed=1.0, child='base_link'):
    records = []
    for k, stamp in enumerate(stamps):
        message = ros_types.odometry(stamp, Pose2D(speed * 0.1 * k), speed, 0.0)
        message.child_frame_id = child
        records.append((f'{prefix}/odom', stamp, message))
    return records


@pytest.fixture
def scans(make_scan):
    def make(topic='/scan', frame='laser', stamps=STAMPS, **fields):
        return [(topic, stamp, make_scan(stamp, frame=frame, **fields)) for stamp in stamps]

    return make


def tf(prefix='', base='base_link', y=0.0, stamps=STAMPS):
    moving = [
        (f'{prefix}/tf', stamp, transform(stamp, 'odom', base, 0.1 * k, y, 0.0))
        for k, stamp in enumerate(stamps)
    ]
    held = [
        (f'{prefix}/tf', stamp, transform(stamp, 'map', 'odom', 5.0, 0.0, 0.0)) for stamp in stamps
    ]
    return moving + held


def static(child, x, y, yaw, roll=0.0, base='base_link', topic='/tf_static'):
    return (topic, STAMPS[0] - 1, transform(STAMPS[0] - 1, base, child, x, y, yaw, roll))


def test_odometry_alone(choose, scans):
    topics, placed, said = choose([*scans(), *odometry()], kind='ros1')
    assert (topics.pose_source, topics.pose_name, topics.map_frame) == ('odom', '/odom', 'odom')
    assert [one.pose.x_m for one in placed] == pytest.approx([0.1 * k for k in range(8)])
    assert said == [
        'poses from /odom (nav_msgs/msg/Odometry, 100 % of 8 scans)',
        'sensor frame laser is not base_link, and neither tf nor parameters say where it sits: '
        'taken as at its origin, not turned; expected a transform base_link -> laser, or '
        'mount.x, mount.y, mount.yaw',
    ]


def test_what_covers_the_scans_best_is_taken_and_the_rest_named(choose, scans, make_pose):
    click = [('/initialpose', STAMPS[2], make_pose(STAMPS[2]))]
    topics, placed, said = choose(
        [*scans(), *odometry(), *tf(), *click, static('laser', 0.2, 0.0, 0.0)]
    )
    assert (topics.pose_source, topics.map_frame, topics.base_frame) == ('tf', 'map', 'base_link')
    assert placed[0].pose.x_m == pytest.approx(5.2)
    assert said[0] == (
        'poses from tf map -> base_link (100 % of 8 scans); also there: /odom 100 %, tf odom -> '
        'base_link 100 %, /initialpose 12 %'
    )
    assert said[1].startswith('laser on base_link at 0.2 0 m')


@pytest.mark.parametrize(
    ('choice', 'source', 'first_x'),
    [
        ({'pose_source': 'odom'}, 'odom', 0.2),
        ({'pose_topic': 'odom'}, 'odom', 0.2),
        ({'pose_source': 'tf'}, 'tf', 5.2),
        ({'pose_source': 'tf', 'map_frame': 'odom'}, 'tf', 0.2),
        ({'pose_source': 'pose_stamped'}, 'pose_stamped', 7.2),
        ({'pose_source': 'particles'}, 'particles', 8.2),
    ],
)
def test_a_source_that_is_named(choose, scans, choice, source, first_x):
    points, clouds = [], []
    for stamp in STAMPS:
        cloud = ros_types.pose_array(stamp, 'map', np.array([[8.0, 0, 0]]))
        clouds.append(('/cloud', stamp, cloud))
        points.append(('/tracked', stamp, ros_types.pose_stamped(stamp, 'map', Pose2D(7.0))))
    records = [*scans(), *odometry(), *tf(), *points, *clouds, static('laser', 0.2, 0.0, 0.0)]
    topics, placed, said = choose(records, **choice)
    assert topics.pose_source == source
    assert placed[0].pose.x_m == pytest.approx(first_x)
    assert 'also there: ' in said[0] or 'pose_topic' in choice


def test_a_source_that_is_not_there(choose, scans):
    records = [*scans(), *odometry(), *tf()]
    with pytest.raises(
        BagError,
        match=r'no poses in it: expected .*PoseArray; there are /odom \(--pose-source odom\), tf',
    ):
        choose(records, pose_source='particles')
    with pytest.raises(BagError, match=r'odom has type .*Odometry: expected .*PoseArray'):
        choose(records, pose_source='particles', pose_topic='odom')
    with pytest.raises(BagError, match='no scans in it on /front'):
        choose(records, scan_topic='/front')
    with pytest.raises(BagError, match="scan topic is ', ': expected names of topics"):
        choose(records, scan_topic=', ')
    assert [topic.name for topic in choose(records, scan_topic='scan,/scan')[0].scans] == ['/scan']
    with pytest.raises(BagError, match=r'no poses at the stamps of the scans .*/odom 120\.0 to'):
        choose([*scans(), *odometry(stamps=[t + 100 * SECOND for t in STAMPS])])


def test_a_turned_laser_whose_transforms_repeat_themselves(choose, scans):
    """ROS 1 before tf2: static transforms come on /tf, now and then, and not at the ends."""
    repeated = [
        ('/tf', stamp, transform(stamp, 'base_link', 'laser', 0.0, 0.1, 1.5))
        for stamp in (STAMPS[3], STAMPS[5])
    ]
    _, placed, _ = choose([*scans(), *odometry(), *repeated], kind='ros1')
    assert len(placed) == 8
    assert {round(one.pose.yaw_rad, 6) for one in placed} == {1.5}


def test_poses_of_another_frame_of_the_robot(choose, scans):
    """Odometry of a camera: the laser sits elsewhere on it than on the base."""
    records = [
        *scans(),
        *odometry(child='camera'),
        static('laser', 0.2, 0.0, 0.0),
        static('camera', 0.5, 0.0, 0.0),
    ]
    topics, placed, _ = choose(records)
    assert topics.base_frame == 'camera'
    assert placed[0].pose.x_m == pytest.approx(-0.3)


def test_what_is_said_in_the_frame_of_the_robot_is_no_pose_of_it(choose, scans):
    near = [
        ('/nearest', stamp, ros_types.pose_stamped(stamp, 'base_link', Pose2D(1.0)))
        for stamp in STAMPS
    ]
    topics, _, said = choose([*scans(), *odometry(), *near, static('laser', 0.2, 0.0, 0.0)])
    assert topics.pose_name == '/odom'
    assert '/nearest' not in said[0]


def test_odometry_whose_frame_hangs_below_the_base(choose, scans):
    """KISS-ICP sends tf from the base down to odom_lidar, not to give it a second parent."""
    records = [*scans(), static('laser', 0.2, 0.0, 0.0)]
    for k, (_, stamp, message) in enumerate(odometry()):
        message.header.frame_id = 'odom_lidar'
        records.append(('/kiss/odometry', stamp, message))
        inverse = transform(stamp, 'base_link', 'odom_lidar', -0.1 * k, 0.0, 0.0)
        records.append(('/tf', stamp, inverse))
    topics, placed, said = choose(records)
    assert topics.pose_name == '/kiss/odometry'
    assert 'also there: tf odom_lidar -> base_link 100 %' in said[0]
    assert placed[3].pose.x_m == pytest.approx(0.5)
    _, by_tf, _ = choose(records, pose_source='tf')
    assert by_tf[3].pose.x_m == pytest.approx(0.5)


def test_two_lasers_on_two_topics(choose, scans):
    """Stamps are the same; each has its mount, and the second of one sensor is left out."""
    records = [
        *scans('/rear/scan', 'rear_laser'),
        *scans('/scan', 'laser', range_max=9.0),
        *scans('/scan_filtered', 'laser'),
        *scans('/camera', 'camera'),
        *odometry(),
        static('laser', 0.2, 0.0, 0.0),
        static('rear_laser', -0.2, 0.0, 3.0),
    ]
    topics, placed, said = choose(records)
    assert topics.scan_names == '/scan,/rear/scan'
    assert len(placed) == 16
    heads = {(one.scan.frame_id, round(one.pose.yaw_rad, 6)) for one in placed}
    assert heads == {('laser', 0.0), ('rear_laser', 3.0)}
    assert said[0] == (
        'scans from /scan (laser), /rear/scan (rear_laser); also there: /camera (nothing says '
        'where camera sits), /scan_filtered (of laser as well)'
    )
    assert sum(' on base_link at ' in line for line in said) == 2
    _, placed, _ = choose(records, mounts=MountConfig(frames='camera 1 0 0'))
    assert len(placed) == 24
    _, placed, _ = choose(records, scan_topic='/rear/scan, camera')
    assert {one.scan.frame_id for one in placed} == {'rear_laser', 'camera'}


def test_two_lasers_on_one_topic(choose, scans):
    records = [
        *scans(),
        *scans(frame='rear'),
        *odometry(),
        static('laser', 0.2, 0.0, 0.0),
        static('rear', -0.2, 0.0, 3.0),
    ]
    _, placed, said = choose(records)
    assert len(placed) == 16
    assert sum('(from tf_static)' in line for line in said) == 2


def test_several_robots_with_namespaces(choose, scans):
    """Frames are called alike in both; only the first robot is mapped, by its own transforms."""
    records = []
    for k, name in enumerate(('/robot2', '/robot1')):
        records += scans(f'{name}/scan')
        records += odometry(name)
        records += tf(name, y=float(k + 1))
        records += [static('laser', 0.0, 0.0, 0.5 * (k + 1), topic=f'{name}/tf_static')]
    topics, placed, said = choose(records)
    assert topics.scan_names == '/robot1/scan'
    assert placed[0].pose.y_m == pytest.approx(2.0)
    assert placed[0].pose.yaw_rad == pytest.approx(1.0)
    assert said[0] == 'scans of robot robot1; also there: robot2 (--scan-topic)'
    assert 'robot2' not in said[1]
    topics, placed, said = choose(records, scan_topic='robot2/scan')
    assert 'robot1' not in said[0]
    assert placed[0].pose.yaw_rad == pytest.approx(0.5)


def test_several_robots_whose_frames_alone_tell_them_apart(choose, scans):
    """One /tf for all, one map: the laser of another robot is no laser that moves on this one."""
    records = []
    for robot in ('a', 'b'):
        moving = [
            ('/tf', t, transform(t, 'map', f'{robot}/base_link', k, 0, 0)) for k, t in NUMBERED
        ]
        records += [*moving, static(f'{robot}/laser', 0.2, 0, 0, base=f'{robot}/base_link')]
        records += scans(f'/{robot}/scan', f'{robot}/laser')
    topics, placed, said = choose(records, max_speed_m_s=100.0)
    assert topics.scan_names == '/a/scan'
    assert (len(placed), placed[0].scan.frame_id) == (len(STAMPS), 'a/laser')
    assert said[0] == (
        'scans from /a/scan (a/laser); '
        'also there: /b/scan (b/laser is not of the robot of a/base_link)'
    )
    topics, placed, _ = choose(records, scan_topic='/b/scan', max_speed_m_s=100.0)
    assert (topics.base_frame, placed[0].scan.frame_id) == ('b/base_link', 'b/laser')


def test_transforms_of_the_root_serve_where_a_robot_has_none():
    names = ('/tf', '/tf_static', '/a/tf', '/b/tf', '/b/tf_static')
    held = [BagTopic(name, 'tf2_msgs/msg/TFMessage', 1) for name in names]

    def used(scan):
        return [topic.name for topic in transform_topics(held, scan)]

    assert used('/a/front/scan') == ['/a/tf', '/tf_static']
    assert used('/b/scan') == ['/b/tf', '/b/tf_static']
    assert used('/scan') == ['/tf', '/tf_static']
    assert [t.name for t in transform_topics(held[2:], '/scan')] == list(names[2:])


def test_poses_that_come_rarely(choose, scans, make_pose):
    rare = [('/amcl_pose', t, make_pose(t)) for t in (STAMPS[0], STAMPS[-1])]
    _, placed, said = choose([*scans(), *rare])
    assert len(placed) == 8
    assert said[1].startswith('poses on /amcl_pose come every 0.7 s: ')


@pytest.mark.parametrize('always', [0, STAMPS[0]])
def test_stamps_that_are_all_the_same(choose, make_scan, make_pose, always):
    """A driver that sets none, a clock that stands still: what was recorded when is known."""
    records = []
    for k, time in enumerate(SLOW):
        records.append(('/pose', time, make_pose(always, x=float(k))))
        records.append(('/scan', time, make_scan(always, ranges=[k + 1.0] * 5)))
    topics, placed, said = choose(records, max_speed_m_s=100.0)
    assert [scan.pose.x_m for scan in placed] == [0, 1, 2, 3, 4, 5, 6, 7]
    assert [scan.scan.stamp_ns for scan in placed] == SLOW
    assert topics.unstamped == {'/pose', '/scan'}
    same = 'stamps on /pose, /scan are all 0 or all the same: '
    assert f'{same}the times of recording are taken' in said
    with pytest.raises(BagError, match=f'{same}expected those'):
        topics.require_stamps('bag')


def test_a_clock_that_stood_still_with_poses_on_tf(choose, make_scan):
    records = []
    for k, time in enumerate(SLOW):
        records.append(('/scan', time, make_scan(SLOW[0])))
        records.append(('/tf', time, transform(SLOW[0], 'odom', 'base_link', 0.1 * k, 0.0, 0.0)))
    records.append(static('laser', 0.2, 0.0, 0.0))
    topics, placed, said = choose(records)
    assert [scan.pose.x_m for scan in placed] == pytest.approx(0.2 + 0.1 * np.arange(8))
    assert (topics.unstamped, topics.unstamped_frames) == ({'/scan'}, ('base_link',))
    assert any('to base_link are all 0 or all the same' in line for line in said)


def test_messages_of_one_moment_keep_their_stamp(choose, make_scan):
    """Two lasers of one sweep, recorded one after the other: nodes can place them."""
    records = []
    for k, frame in enumerate(('laser', 'other')):
        time = STAMPS[0] + k * SECOND // 50
        records.append(('/scan', time, make_scan(STAMPS[0], frame=frame)))
        records.append(('/tf', time, transform(STAMPS[0], 'odom', 'base_link', 1.0, 0.0, 0.0)))
    records += [static('laser', 0.2, 0.0, 0.0), static('other', 0.3, 0.0, 0.0)]
    topics, placed, _ = choose(records)
    assert [scan.pose.x_m for scan in placed] == pytest.approx([1.2, 1.3])
    assert [scan.scan.stamp_ns for scan in placed] == [STAMPS[0]] * 2
    assert (topics.unstamped, topics.unstamped_frames) == (frozenset(), ())
    topics.require_stamps('bag')


def test_first_stamps_of_0_stay_what_they_are(choose, scans, make_scan):
    """A simulation whose clock had not begun: other stamps are known."""
    records = [('/scan', 5, make_scan(0)), *scans(), *odometry()]
    topics, placed, _ = choose(records)
    assert (len(placed), topics.unstamped) == (len(STAMPS), frozenset())
    topics.require_stamps('bag')


def test_transforms_without_stamps_count_from_when_they_were_recorded(choose, scans):
    """Of all frames; one that is sent once and for no time holds always."""
    moving = [
        ('/tf', t, transform(0, 'odom', 'base_link', 0.1 * k, 0.0, 0.0))
        for k, t in enumerate(STAMPS)
    ]
    once = ('/tf', STAMPS[3], transform(0, 'map', 'odom', 5.0, 0.0, 0.0))
    topics, placed, said = choose([*scans(), *moving, once, static('laser', 0.2, 0.0, 0.0)])
    assert [scan.pose.x_m for scan in placed] == pytest.approx(5.2 + 0.1 * np.arange(8))
    assert said[0] == 'poses from tf map -> base_link (100 % of 8 scans); also there: tf odom ' + (
        '-> base_link 100 %'
    )
    assert said[1] == (
        'stamps of transforms to base_link are all 0 or all the same: '
        'the times of recording are taken'
    )
    topics.require_stamps('bag')  # poses at the stamps of the scans can be computed
    first = ('/tf', STAMPS[0], transform(0, 'odom', 'base_link', 0.0, 0.0, 0.0))
    assert choose([*scans(), first, *tf()])[2] == choose([*scans(), *tf()])[2]
    # What carries no sensor does not count; the base does, wherever the sensor sits on it.
    ball = [('/tf', t, transform(0, 'odom', 'ball', 0.1, 0.0, 0.0)) for t in STAMPS]
    topics, _, _ = choose([*scans(frame='unknown'), *moving, *ball])
    assert topics.unstamped_frames == ('base_link',)


def test_a_frame_that_was_asked_for_and_is_not_there(choose, scans):
    records = [*scans(), *tf(), static('laser', 0.2, 0.0, 0.0)]
    expected = r"frame 'world' \(map_frame\) is not in its transforms \(map > odom > base_link.*"
    with pytest.raises(BagError, match=expected + r'tf map -> base_link \(--map-frame map\)'):
        choose(records, pose_source='tf', map_frame='world')
    with pytest.raises(BagError, match=expected):
        choose(records, map_frame='world')


def test_nothing_measured_is_said(choose, scans):
    """Millimetres in place of metres; a lidar that sees nothing."""
    _, placed, said = choose([*scans(ranges=[1500.0, 8000.0]), *odometry()])
    assert len(placed) == len(STAMPS)
    assert 'nothing was measured: no range is from' in said[-1]
    assert 'those of the last scan are from 1500 to 8000' in said[-1]
    assert 'not finite' in choose([*scans(ranges=[np.nan] * 5), *odometry()])[2][-1]
    assert 'nothing was hit' in choose([*scans(ranges=[np.inf] * 5), *odometry()])[2][-1]
    assert 'nothing was' not in str(choose([*scans(), *odometry()])[2])


def test_covariances_are_looked_at_where_they_are_needed(choose, scans, make_pose):
    bad = [('/pose', stamp, make_pose(stamp, variances=(-1.0, 0, 0))) for stamp in STAMPS]
    _, placed, _ = choose([*scans(), *bad], beliefs=False)
    assert len(placed) == 8
    with pytest.raises(BagError, match='none of 8 scans could be placed'):
        choose([*scans(), *bad])


def test_a_header_and_a_count_that_disagree_are_told_once(choose, scans):
    records = [*scans(angle_max=5.0), *odometry(), static('laser', 0.0, 0.0, 0.0)]
    _, placed, said = choose(records)
    assert len(placed) == 8
    assert sum(line.startswith('/scan: 5 ranges, but angles from -1 to 5') for line in said) == 1
