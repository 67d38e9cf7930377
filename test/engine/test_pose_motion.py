"""What is published as a pose and does not go where the robot goes."""

import numpy as np
import pytest
from support.transforms import transform

from ogm_mcmc.engine.bag_topics import choose_topics
from ogm_mcmc.engine.pose_motion import moves_alike
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader

SECOND = 1_000_000_000
STAMPS = [1_700_000_000 * SECOND + k * SECOND // 5 for k in range(12)]


def at(*x):
    return np.array([(value, 0.0) for value in x])


@pytest.mark.parametrize(
    ('places', 'odometry', 'alike'),
    [
        (at(5, 5, 5, 5), at(0, 1, 2, 3), False),
        (at(5, 6, 7, 8), at(0, 1, 2, 3), True),
        (at(5, 5.6, 6.2, 6.8), at(0, 1, 2, 3), True),  # wheels that slip
        (at(5, 8, 11, 14), at(0, 1, 2, 3), False),
        (at(5, 6, 99, 100, 101), at(0, 1, 2, 3, 4), True),  # a localizer that found its place
        (at(5, 5, 5, 5), at(0, 0, 0, 0), True),  # the robot stands
        (at(5, 9, 2, 7), at(0, 0, 0, 0), True),  # or its wheels tell nothing
        (at(5, 5, 5), at(0, 1, 2), True),  # too few
        (at(5, np.nan, 5, 5, 5, np.nan), at(0, 1, 2, 3, 4, 5), True),
        (at(5, np.nan, 5, 5, 5, 5), at(0, 1, 2, 3, 4, 5), False),
    ],
)
def test_who_goes_as_far_as_the_odometry(places, odometry, alike):
    assert moves_alike(places, odometry) is alike


@pytest.fixture
def choose(write_bag, make_scan):
    """Write scans and odometry along x with other records and choose: topics."""

    def run(records, *, tf=False, still=False, **choice):
        held = [('/scan', stamp, make_scan(stamp)) for stamp in STAMPS]
        for k, stamp in enumerate(STAMPS):
            message = ros_types.odometry(0 if still else stamp, Pose2D(0.2 * k), 1.0, 0.0)
            moved = transform(stamp, 'odom', 'base_link', 0.2 * k, 0.0, 0.0)
            held.append(('/tf', stamp, moved) if tf else ('/odom', stamp, message))
        with BagReader(write_bag(held + records)) as bag:
            return choose_topics(bag, StreamChoice(**choice))

    return run


def points(topic, x, frame='map', still=False):
    return [
        (topic, t, ros_types.pose_stamped(0 if still else t, frame, Pose2D(x(k))))
        for k, t in enumerate(STAMPS)
    ]


@pytest.mark.parametrize('tf', [False, True])
def test_a_ball_that_lies_still_is_not_the_robot(choose, tf):
    topics = choose(points('/ball', lambda k: 5.0), tf=tf)
    assert topics.pose_source == ('tf' if tf else 'odom')
    source = 'tf' if tf else '/odom'
    assert f'/ball does not move as {source} does: not taken for the robot' in topics.remarks
    assert 'also there: /ball 100 %' in topics.remarks[0]
    # Who names it has it.
    assert choose(points('/ball', lambda k: 5.0), tf=tf, pose_topic='/ball').pose_name == '/ball'


@pytest.mark.parametrize(('ball', 'odometry'), [(True, False), (False, True), (True, True)])
def test_a_ball_is_told_where_clocks_stand_still(choose, ball, odometry):
    """By the times of recording, as poses are taken then."""
    topics = choose(points('/ball', lambda k: 5.0, still=ball), still=odometry)
    assert topics.pose_name == '/odom'
    assert '/ball does not move as /odom does: not taken for the robot' in topics.remarks
    found = choose(points('/tracked', lambda k: 7.0 + 0.2 * k, still=ball), still=odometry)
    assert found.pose_name == '/tracked'


def test_a_localizer_comes_before_odometry(choose):
    found = points('/tracked', lambda k: 7.0 + 0.2 * k) + points('/ball', lambda k: 5.0)
    topics = choose(found)
    assert topics.pose_name == '/tracked'


@pytest.mark.parametrize(
    ('topic', 'frame'),
    [('/apriltag/pose', 'map'), ('/thing', 'camera_color_optical_frame'), ('/plan/pose', 'map')],
)
def test_what_a_camera_or_a_planner_says_is_not_the_robot(choose, topic, frame):
    """Even where it moves alike."""
    topics = choose(points(topic, lambda k: 0.2 * k, frame))
    assert topics.pose_name == '/odom'


def test_a_click_alone_is_no_source_of_poses(write_bag, make_scan, make_pose):
    records = [('/scan', stamp, make_scan(stamp)) for stamp in STAMPS]
    records.append(('/initialpose', STAMPS[0], make_pose(STAMPS[0])))
    with BagReader(write_bag(records)) as bag:
        with pytest.raises(BagError, match=r'no poses at the stamps of the scans .*/initialpose'):
            choose_topics(bag, StreamChoice())
        chosen = choose_topics(bag, StreamChoice(pose_topic='/initialpose'))
    assert chosen.pose_name == '/initialpose'
