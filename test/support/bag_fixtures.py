"""Small logs, messages and bags that several modules here share."""

from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader, BagWriter, typestore
from support.ros1_bags import write_ros1


@pytest.fixture
def write_log(tmp_path):
    """Write a text log into the test's folder."""

    def write(*lines, name='small.log'):
        path = tmp_path / name
        path.write_bytes(''.join(f'{line}\n' for line in lines).encode())
        return path

    return write


@pytest.fixture(scope='session')
def laser_line():
    """Make a line of the old laser format; the odometry pose in it is far from the laser's."""

    def line(time_s, readings=(2.5,) * 180, pose=(1.0, 2.0, 0.5), kind='FLASER'):
        x, y, theta = pose
        numbers = ' '.join(str(reading) for reading in readings)
        return f'{kind} {len(readings)} {numbers} {x} {y} {theta} 70 80 0.9 {time_s} host {time_s}'

    return line


@pytest.fixture(scope='session')
def robot_laser_line():
    """Make a line of the new laser format (three readings from -0.5 rad, 0.5 rad apart)."""

    def line(time_s, readings=(1.0, 2.0, 3.0), max_range=50.0, laser=1, pose=(1.0, 2.0, 0.5)):
        x, y, theta = pose
        numbers = ' '.join(str(reading) for reading in readings)
        return (
            f'ROBOTLASER{laser} 0 -0.5 1.0 0.5 {max_range} 0.01 0 {len(readings)} {numbers} 0 '
            f'{x} {y} {theta} 70 80 0.9 0 0 0.3 0.2 0.1 {time_s} host {time_s}'
        )

    return line


@pytest.fixture(scope='session')
def make_scan():
    """Make a LaserScan of five beams from -1 rad, 0.5 rad apart; fields by name replace others."""

    def scan(stamp_ns, ranges=(1.0, 2.0, np.inf, 3.0, 4.0), frame='laser', **fields):
        message = ros_types.laser_scan(
            stamp_ns,
            frame,
            np.array(ranges, np.float32),
            angle_min=-1.0,
            angle_increment=0.5,
            range_max=10.0,
        )
        for name, value in fields.items():
            setattr(message, name, value)
        return message

    return scan


@pytest.fixture(scope='session')
def make_pose():
    """Make a PoseWithCovarianceStamped; `variances` of x, y, yaw."""

    def pose(stamp_ns, x=0.0, y=0.0, yaw=0.0, variances=(0.0, 0.0, 0.0), frame='map'):
        return ros_types.pose_with_covariance(
            stamp_ns, frame, Pose2D(x, y, yaw), np.diag(variances)
        )

    return pose


@pytest.fixture
def write_bag(tmp_path):
    """Write (topic, time ns, message) in the order given; kind: mcap, sqlite3 or ros1."""

    def write(records, kind='mcap', name='bag'):
        if kind == 'mcap':
            path = tmp_path / name
            with BagWriter(path, overwrite=True) as bag:
                for topic, time_ns, message in records:
                    bag.write(topic, message.__msgtype__, time_ns, message)
            return path
        if kind == 'ros1':
            path = tmp_path / f'{name}.bag'
            write_ros1(path, records)
            return path
        path, types = tmp_path / name, typestore()
        with Ros2Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            connections = {}
            for topic, time_ns, message in records:
                msgtype = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, msgtype, typestore=types)
                writer.write(connections[topic], time_ns, types.serialize_cdr(message, msgtype))
        return path

    return write


@pytest.fixture(scope='session')
def read_bag():
    """Read a whole bag: `topics` {name: [(ns, message), ...]}, `order` [(ns, name), ...]."""

    def read(path):
        topics, order = {}, []
        with BagReader(path) as bag:
            for record in bag.records():
                topics.setdefault(record.topic, []).append((record.time_ns, bag.decode(record)))
                order.append((record.time_ns, record.topic))
        return SimpleNamespace(topics=topics, order=order)

    return read
