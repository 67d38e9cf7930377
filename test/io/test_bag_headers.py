import numpy as np
import pytest

from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bag_headers import stored_header
from ogm_mcmc.io.bags import BagReader

STAMP = 1_700_000_000_123_456_789


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3', 'ros1'])
def test_as_the_decoded_message_says(write_bag, make_scan, make_pose, kind):
    records = [
        ('/scan', 1, make_scan(STAMP, frame='/laser')),
        ('/pose', 2, make_pose(STAMP + 1, frame='map')),
        ('/odom', 3, ros_types.odometry(STAMP + 2, Pose2D(), 0.0, 0.0)),
        ('/particles', 4, ros_types.pose_array(STAMP + 3, '', np.zeros((2, 3)))),
    ]
    with BagReader(write_bag(records, kind)) as bag:
        for record in bag.records():
            message = bag.decode(record)
            expected = messages.stamp_of(message), messages.frame_of(message)
            assert stored_header(record) == expected


def test_bytes_that_hold_no_header(write_bag, make_scan):
    with BagReader(write_bag([('/scan', 1, make_scan(STAMP))])) as bag:
        (record,) = bag.records()
    assert stored_header(record._replace(raw=record.raw[:9])) is None
    assert stored_header(record._replace(raw=record.raw[:16] + b'\xff' * 20)) is None
