"""Scans bent for when their beams were taken."""

from dataclasses import replace

import numpy as np
import pytest
from support.rooms import path_through, scans_at_times, scans_of

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.engine.beam_times import BentScans, beam_times_figures, said_beam_times
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.trajectory.beam_times import BeamTimes, bent_points
from ogm_mcmc.trajectory.points import ScanPoints, poses_of

TRUTH = path_through(6)
SPEEDS = np.tile((1.5, -0.2, 0.8), (6, 1))
SECONDS = np.array([0.013, 0.007])


def test_a_bent_scan_ends_where_its_bent_points_lie() -> None:
    scans = scans_of(TRUTH, 60, 0.01)
    scans[2].ranges_m[5:9] = np.nan
    bent = BentScans().bent(scans, SPEEDS, SECONDS)
    expected = bent_points(ScanPoints.of(scans), SPEEDS, SECONDS)
    found = ScanPoints.of(bent)
    np.testing.assert_allclose(found.local, expected.local, atol=1e-6)
    np.testing.assert_array_equal(found.scan, expected.scan)
    assert np.abs(found.local - ScanPoints.of(scans).local).max() > 0.01


def test_a_scan_bent_the_same_way_stays_the_same_object() -> None:
    scans, kept = scans_of(TRUTH, 60, 0.01), BentScans()
    first = kept.bent(scans, SPEEDS, SECONDS)
    assert all(one is not scan for one, scan in zip(first, scans, strict=True))
    nearly = kept.bent(scans[1:], 1.001 * SPEEDS[1:], SECONDS)
    assert all(one is old for one, old in zip(nearly, first[1:], strict=True))
    other = kept.bent(scans, np.concatenate((SPEEDS[:3], 2.0 * SPEEDS[3:])), SECONDS)
    assert [one is old for one, old in zip(other, first, strict=True)] == [
        False, True, True, False, False, False,  # the first had been left out
    ]  # fmt: skip
    still = kept.bent(scans, np.zeros((6, 3)), SECONDS)
    assert all(one is scan for one, scan in zip(still, scans, strict=True))
    at_once = kept.bent(scans, SPEEDS, BeamTimes.at_once().seconds)
    assert all(one is scan for one, scan in zip(at_once, scans, strict=True))


def test_joint_poses_hand_scans_on_as_they_saw_them() -> None:
    truth = path_through(10)
    scans = scans_at_times(truth, 60, 0.005, 0.1, (0.012, 0.0))
    stamped = [replace(scan, stamp_ns=10**8 * (1 + k)) for k, scan in enumerate(scans)]
    placed = [PlacedScan.at(*one) for one in zip(stamped, poses_of(truth), strict=True)]
    poses = PoseRefinement(placed, TrajectoryConfig(draws=2))
    for _ in poses.run():
        pass
    after = poses.placed()
    points = ScanPoints.of([one.scan for one in after])
    np.testing.assert_allclose(points.local, poses.estimator.points.local, atol=1e-6)
    assert all(one.scan is not old.scan for one, old in zip(after, placed, strict=True))
    assert all(a.scan is b.scan for a, b in zip(after, poses.placed(), strict=True))
    figures = poses.figures()['beam_times']
    assert figures['turns_s'] == pytest.approx(0.012, abs=0.002)
    assert 0.0 < figures['turns_deviation_s'] < 0.002
    assert figures['sweep_s'] == 0.0


@pytest.mark.parametrize('offset', [Pose2D(), Pose2D(-0.6, 0.0, np.pi)])
def test_scans_of_several_sensors_do_not_tell_when_beams_were_taken(offset) -> None:
    truth = path_through(10)
    scans = scans_at_times(truth, 30, 0.005, 0.1, (0.012, 0.0))
    placed = [
        PlacedScan(
            replace(scan, stamp_ns=10**8 * (1 + k), frame_id='front'),
            PoseBelief(pose, offset=offset if k % 2 else Pose2D()),
        )
        for k, (scan, pose) in enumerate(zip(scans, poses_of(truth), strict=True))
    ]
    poses = PoseRefinement(placed, TrajectoryConfig(draws=2))
    for _ in poses.run():
        pass
    one = offset == Pose2D()
    assert poses.estimator.speeds.any() == one
    assert ('several sensors' in poses.said_beam_times()) == (not one)
    placed[3] = placed[3]._replace(scan=replace(placed[3].scan, frame_id='back'))
    assert 'several sensors' in PoseRefinement(placed, TrajectoryConfig()).said_beam_times()
    off = TrajectoryConfig(beam_times=False)
    assert PoseRefinement(placed, off).said_beam_times() == ''


def test_one_sensor_that_moves_on_the_robot_is_not_told_to_be_several() -> None:
    scans = scans_of(TRUTH, 30, 0.01)
    placed = [
        PlacedScan(scan, PoseBelief(pose, offset=Pose2D(0.2, 0.0, 0.02 * k)))
        for k, (scan, pose) in enumerate(zip(scans, poses_of(TRUTH), strict=True))
    ]
    said = PoseRefinement(placed, TrajectoryConfig()).said_beam_times()
    assert said.startswith('scans of several sensors, or of one that moves on the robot: ')


@pytest.mark.parametrize(
    ('seconds', 'said'),
    [
        ((0.0, 0.0), ''),
        ((0.0133, 0.0), 'odd ones 13.30 ms after even ones'),
        ((-0.0133, 0.0), 'odd ones 13.30 ms before even ones'),
        ((0.0, 0.0067), '6.70 ms from the first to the last'),
        ((0.001, -0.02), 'even ones, 20.00 ms from the last to the first'),
    ],
)
def test_a_line_says_when_beams_were_taken(seconds, said) -> None:
    line = said_beam_times(BeamTimes(np.array(seconds), np.full(2, 1e-4)))
    assert line.endswith(said)
    assert bool(line) == bool(said)


def test_what_is_not_known_is_null_in_json() -> None:
    assert beam_times_figures(BeamTimes.at_once()) == {
        'turns_s': 0.0, 'turns_deviation_s': None, 'sweep_s': 0.0, 'sweep_deviation_s': None,
    }  # fmt: skip
