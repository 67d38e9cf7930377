"""Sigma from pairs of beams: against a plain double loop, and against what was simulated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ogm_mcmc.engine import range_pairs
from ogm_mcmc.engine.range_pairs import IN_CELL, narrower, spread_of_pairs
from ogm_mcmc.engine.range_pairs import _distances as distances
from ogm_mcmc.engine.range_spread import Spread
from ogm_mcmc.geometry import PlacedScan, Pose2D, Scan

CELL = 0.05
TILT = 0.4  # of the wall against the lattice, rad


def scan_of(ranges, pose):
    scan = Scan.checked(
        np.asarray(ranges, np.float32),
        angle_min_rad=-0.6,
        angle_increment_rad=1.2 / max(1, len(ranges) - 1),
        range_min_m=0.0,
        range_max_m=20.0,
    )
    return PlacedScan.at(scan, pose)


def wall_seen(rng, n_scans, beams, noise_m, pose_m=0.0, side=1.0):
    """Scans of a wall through the origin, tilted, from places 2 to 3 m before it (side 1)."""
    normal = np.array([-math.sin(TILT), math.cos(TILT)]) * -side
    along = np.array([math.cos(TILT), math.sin(TILT)])
    scans = []
    for _ in range(n_scans):
        x, y = rng.uniform(2.0, 3.0) * normal + rng.uniform(-0.5, 0.5) * along
        yaw = math.atan2(-normal[1], -normal[0]) + rng.uniform(-0.3, 0.3)
        angles = yaw + np.linspace(-0.6, 0.6, beams)
        toward = -(np.cos(angles) * normal[0] + np.sin(angles) * normal[1])
        exact = (x * normal[0] + y * normal[1]) / toward
        dx, dy = pose_m * rng.standard_normal(2)
        ranges = exact + noise_m * rng.standard_normal(beams)
        scans.append(scan_of(ranges, Pose2D(x + dx, y + dy, yaw)))
    return scans


def cell_of(pose, angle, r):
    x, y = pose.x_m + r * math.cos(angle), pose.y_m + r * math.sin(angle)
    return math.floor(x / CELL), math.floor(y / CELL)


def test_distances_are_those_of_a_plain_loop():
    scans = wall_seen(np.random.default_rng(1), 12, 9, 0.02)
    readings = [
        (number, p.pose, math.atan2(math.sin(a), math.cos(a)), float(r))
        for number, p in enumerate(scans)
        for a, r in zip(p.pose.yaw_rad + p.scan.bearings(), p.scan.ranges_m, strict=True)
    ]
    expected = []
    for of, pose, angle, r in readings:
        nearest = None
        passed = {cell_of(pose, angle, r + step * CELL) for step in np.arange(-8.0, 8.5, 0.5)}
        for other_of, other_pose, other_angle, other_r in readings:
            if other_of == of or math.cos(angle - other_angle) <= 0.5:
                continue
            dx = other_pose.x_m + other_r * math.cos(other_angle) - pose.x_m
            dy = other_pose.y_m + other_r * math.sin(other_angle) - pose.y_m
            along = dx * math.cos(angle) + dy * math.sin(angle)
            aside = abs(dy * math.cos(angle) - dx * math.sin(angle))
            close = aside <= 0.5 * CELL and abs(r - along) <= 8.0 * CELL
            met = cell_of(other_pose, other_angle, other_r) in passed
            if close and met and (nearest is None or aside < nearest[0]):
                nearest = aside, (r - along) / CELL
        if nearest is not None:
            expected.append(nearest[1])
    assert len(expected) > 30
    np.testing.assert_allclose(
        np.sort(distances(scans, CELL, 0.0, 8.0)), np.sort(expected), rtol=0.0, atol=1e-4
    )


@pytest.mark.parametrize('beams', [90, 8])
@pytest.mark.parametrize(('noise_m', 'pose_m'), [(0.01, 0.0), (0.05, 0.0), (0.01, 0.03)])
def test_noise_and_poses_are_found_whatever_the_number_of_beams(beams, noise_m, pose_m):
    scans = wall_seen(np.random.default_rng(2), 80, beams, noise_m, pose_m)
    found = spread_of_pairs(scans, CELL)
    expected = math.hypot(noise_m, pose_m, IN_CELL * CELL)
    assert found.beams > 100
    assert found.low_95 < found.mean < found.high_95
    # What poses err by across a wall is more along a beam that meets it at an angle.
    assert 0.85 * expected < found.mean < 1.3 * expected


def test_noise_wider_than_pairs_are_looked_for_is_not_called_narrower():
    """Pairs are within 0.4 m: of these of a wide Gaussian four in five are nearer."""
    for noise_m in (0.15, 0.2, 0.3):
        found = spread_of_pairs(wall_seen(np.random.default_rng(2), 80, 40, noise_m), CELL)
        assert found.high_95 > noise_m
        assert 0.95 * noise_m < found.mean < 1.4 * noise_m


def test_of_many_scans_those_of_two_sensors_count(monkeypatch):
    """Scans of sensors that take turns: every second one would be of the first sensor alone."""
    one, other = (wall_seen(np.random.default_rng(6), 60, 40, noise) for noise in (0.01, 0.1))
    both = [scan for pair in zip(one, other, strict=True) for scan in pair]
    monkeypatch.setattr(range_pairs, 'MOST_READINGS', 60 * 40)
    found = spread_of_pairs(both, CELL).mean
    assert spread_of_pairs(one, CELL).mean < 0.03 < 0.05 < found
    assert found < 0.9 * spread_of_pairs(other, CELL).mean


def test_few_pairs_are_held_at_the_default():
    scans = wall_seen(np.random.default_rng(3), 80, 90, 0.01)
    few = wall_seen(np.random.default_rng(3), 3, 12, 0.01)
    assert spread_of_pairs(scans, CELL).mean < 0.025
    assert 1 <= spread_of_pairs(few, CELL).beams < 12
    assert spread_of_pairs(few, CELL).mean > 0.027


def test_beams_of_one_scan_and_of_the_other_side_say_nothing():
    rng = np.random.default_rng(4)
    (here,), (there,) = (wall_seen(rng, 1, 90, 0.01, side=side) for side in (1.0, -1.0))
    assert spread_of_pairs([here], CELL) is None
    assert spread_of_pairs([here, there], CELL) is None
    assert spread_of_pairs([here, there, here], CELL).beams > 20


def test_readings_beyond_the_largest_range_do_not_count():
    scans = wall_seen(np.random.default_rng(5), 10, 20, 0.01)
    assert spread_of_pairs(scans, CELL, 10.0) == spread_of_pairs(scans, CELL)
    assert spread_of_pairs(scans, CELL, 1.0) is None


def test_a_robot_that_stands_still_takes_no_memory():
    """Of the many readings in a cell few are looked at."""
    scans = wall_seen(np.random.default_rng(6), 1, 20, 0.0) * 2000
    found = spread_of_pairs(scans, CELL)
    assert found.beams == 5000
    assert found.mean == pytest.approx(IN_CELL * CELL, rel=0.01)


def test_the_narrower_one_is_taken():
    wide, sharp = Spread(0.05, 0.01, 9, 0.04, 0.06), Spread(0.02, 0.01, 9, 0.01, 0.03)
    untold = Spread(0.05, None, 0, None, None)
    assert narrower(wide, sharp) is narrower(sharp, wide) is narrower(sharp, None) is sharp
    assert narrower(untold, None) is untold
    assert narrower(untold, wide) is wide
