"""`info`: what `map` would take of a bag, and what a trajectory file holds."""

import argparse
import json

import pytest
from support.transforms import transform

from ogm_mcmc.cli import info
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types

STAMPS = [20 * 10**9 + k * 10**8 for k in range(4)]


@pytest.fixture
def told(capsys):
    def run(path, *arguments):
        parser = argparse.ArgumentParser()
        info.add_to(parser.add_subparsers())
        options = parser.parse_args(['info', str(path), *arguments])
        assert options.run(options) == 0
        return capsys.readouterr().out

    return run


def test_what_map_takes(told, write_bag, make_scan):
    records = [('/tf_static', 1, transform(1, 'base_link', 'laser', 0.2, 0.0, 0.0))]
    for stamp in STAMPS:
        records.append(('/scan', stamp, make_scan(stamp)))
        records.append(('/odom', stamp, ros_types.odometry(stamp, Pose2D(), 0.0, 0.0)))
    bag = write_bag(records)
    text = told(bag)
    assert "(transforms ['base_link -> laser'])" in text
    assert '  map: poses from /odom (nav_msgs/msg/Odometry, 100 % of 4 scans)\n' in text
    assert '  map: laser on base_link at 0.2 0 m' in text
    assert len(json.loads(told(bag, '--json'))['map_takes']) == 2
    without = told(write_bag([r for r in records if r[0] == '/scan'], name='other'))
    assert 'no poses in it' in without
    without = told(write_bag([r for r in records if r[0] == '/odom'], name='third'))
    assert 'no scans in it: expected sensor_msgs/msg/LaserScan' in without.splitlines()[-1]


def test_transforms_that_come_in_turn(told, write_bag):
    """Localizer and wheels send each their own on one topic."""
    records = []
    for stamp in STAMPS:
        records.append(('/tf', stamp, transform(stamp, 'map', 'odom', 0.0, 0.0, 0.0)))
        records.append(('/tf', stamp, transform(stamp, 'odom', 'base_link', 0.1, 0.0, 0.0)))
    assert "(transforms ['map -> odom', 'odom -> base_link'])" in told(write_bag(records))


def test_a_trajectory(told, tmp_path):
    path = tmp_path / 'poses.tum'
    path.write_text('20.0 1 2 0 0 0 0 1\n20.5 1 3 0 0 0 0 1\n21.0 -1 3 0 0 0 0 1\n')
    values = json.loads(told(path, '--json'))
    assert (values['kind'], values['poses']) == ('trajectory (TUM)', 3)
    assert (values['length_m'], values['duration_s']) == (3.0, 1.0)
    assert (values['x_m'], values['y_m']) == ([-1.0, 1.0], [2.0, 3.0])
    assert '3 poses, 1.0 s from 20.000 s' in told(path)
