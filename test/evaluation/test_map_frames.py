"""Where a map lies in the frame of beams: found where it was moved to, and said to be nowhere."""

import math

import numpy as np
import pytest
from support.rooms import path_through, scans_of
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, MapperConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.evaluation import (
    ForwardModel,
    FrameSearch,
    beam_log_likelihood,
    find_frame,
    gain_near_by,
    seen_from,
)
from ogm_mcmc.evaluation.map_frames import _Beams
from ogm_mcmc.evaluation.wall_matches import APART, _counting, _Field, wall_matches
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, wrap_angle
from ogm_mcmc.mapping import ProbabilityBeams

CELL = 0.1
MODEL = ForwardModel.from_config(ForwardModelConfig(sigma=0.05))
MOVED = Pose2D(3.0, -2.0, math.radians(130.0))


@pytest.fixture(scope='module')
def room():
    """A map of every other scan of a room, and the scans between them, at their true poses.

    Walls run through the middle of cells: at a border noise decides where they are drawn.
    """
    poses = path_through(12)
    scans = scans_of(poses, 90, 0.01)
    poses[:, :2] += CELL / 2
    placed = [PlacedScan.at(scan, Pose2D(*pose)) for scan, pose in zip(scans, poses, strict=True)]
    return map_of(placed[::2], MapperConfig(resolution=CELL)), placed[1::2]


def moved(placed, frame):
    return [PlacedScan.at(scan, frame.compose(belief.mean)) for scan, belief in placed]


def nats(grid_map, placed):
    return beam_log_likelihood(grid_map, placed, MODEL, prior=0.15).mean()


@pytest.mark.parametrize('wide', [False, True])
def test_a_moved_map_is_found(room, wide):
    grid_map, placed = room
    frame = MOVED if wide else Pose2D(0.4, 0.3, math.radians(7.0))
    search = FrameSearch() if wide else FrameSearch(1.0, math.radians(15.0))
    found = find_frame(grid_map, moved(placed, frame), MODEL, prior=0.15, search=search)
    # Compared where the room is: far away a small turn is a long way.
    here = Pose2D(3.0, 2.0)
    off = frame.compose(here).inverse().compose(found.frame.compose(here))
    assert math.hypot(off.x_m, off.y_m) < CELL / 2
    assert abs(wrap_angle(off.yaw_rad)) < math.radians(0.2)
    there = nats(grid_map, seen_from(found.frame, moved(placed, frame)))
    assert there == pytest.approx(found.nats, abs=1e-3)
    assert there >= nats(grid_map, placed) - 1e-3
    assert found.as_given == pytest.approx(nats(grid_map, moved(placed, frame)), abs=0.01)
    assert found.as_given < found.nats - 1.0
    if wide:
        assert found.elsewhere is not None
        elsewhere = nats(grid_map, seen_from(found.elsewhere, moved(placed, frame)))
        assert elsewhere < there - 1.0


def test_a_map_that_lies_right_stays_about_there(room):
    grid_map, placed = room
    found = find_frame(grid_map, placed, MODEL, prior=0.15, search=FrameSearch())
    assert math.hypot(found.frame.x_m, found.frame.y_m) < CELL / 2
    assert abs(found.frame.yaw_rad) < math.radians(0.2)
    assert 0.0 <= found.nats - found.as_given < 0.1


def test_a_small_move_gains_where_a_map_lies_a_little_off(room):
    grid_map, placed = room
    assert 0.0 <= gain_near_by(grid_map, placed, MODEL, prior=0.15) < 0.1
    off = moved(placed, Pose2D(0.25, -0.2, 0.02))
    gain = gain_near_by(grid_map, off, MODEL, prior=0.15)
    assert 0.5 < gain <= nats(grid_map, placed) - nats(grid_map, off) + 0.1
    silent = [PlacedScan.at(fan(math.inf, range_max_m=5.0), Pose2D())]
    assert gain_near_by(grid_map, silent, MODEL, prior=0.15) == 0.0


def test_what_is_found_lies_in_the_range(room):
    grid_map, placed = room
    away = moved(placed, Pose2D(0.6, 0.1))
    found = find_frame(grid_map, away, MODEL, prior=0.15, search=FrameSearch(0.5, 0.0))
    assert found.frame.yaw_rad == 0.0
    assert 0.4 < math.hypot(found.frame.x_m, found.frame.y_m) <= 0.5 + 1e-9
    assert found.as_given < found.nats


def test_climbing_goes_by_the_likelihood_of_the_judge(room):
    grid_map, placed = room
    frames = np.array([[0.0, 0.0, 0.0], [0.2, -0.1, 0.1], [3.0, -2.0, 2.2]])
    beams = _Beams.some(placed, 10**6)
    assert beams.beams == sum(scan.informative().sum() for scan, _ in placed)
    fit = ProbabilityBeams(grid_map, MODEL, 0.15)
    expected = [nats(grid_map, seen_from(Pose2D(*frame), placed)) for frame in frames]
    assert beams.nats(fit, frames) == pytest.approx(expected, abs=1e-3)
    some = _Beams.some(placed, 100)
    assert 80 <= some.beams <= 120
    assert len(some.scans) == len(placed)


def test_matches_of_a_turn_count_as_by_hand():
    rng = np.random.default_rng(2)
    field = rng.random((5, 7))
    ends = np.unique(rng.integers(-2, 3, (6, 2)), axis=0).astype(float)
    corner, turn = np.array([-3.25, 1.5]), 0.6
    cosine, sine = math.cos(turn), math.sin(turn)

    def counted(x, y):
        """Of a map whose place (x, y) comes to lie on the middle: what all ends count."""
        total = 0.0
        for u, v in ends:
            column = round(cosine * u + sine * v) + math.floor(x - corner[0])
            row = round(cosine * v - sine * u) + math.floor(y - corner[1])
            if 0 <= row < 5 and 0 <= column < 7:
                total += field[row, column]
        return total / len(ends)

    everywhere = [
        counted(corner[0] + c + 0.5, corner[1] + r + 0.5)
        for r in range(-4, 9)
        for c in range(-4, 11)
    ]
    matches = _Field(field, corner, 4).matches(ends, turn, 0.0)
    assert matches[0][0] == pytest.approx(max(everywhere))
    for score, x, y in matches:
        # Back from the shift to the place that lies on the middle.
        place = -(cosine * x + sine * y), -(cosine * y - sine * x)
        assert score == pytest.approx(counted(*place))
    near = _Field(field, corner, 4).matches(ends, turn, 1.0)
    assert 0 < len(near) <= len(matches)
    assert all(math.hypot(x, y) <= 2.0 for _, x, y in near)


def test_what_an_end_counts_for():
    nan = math.nan
    p = np.array([[0.9, 0.1, 0.1, 0.1, nan, nan], [0.1, 0.1, 0.1, 0.3, nan, nan]], np.float32)
    counting = _counting(GridMap(GridSpec(0.1, 6, 2), p), 2)
    assert counting == pytest.approx(np.array([[0.9, 0.54, 0.0]]))
    counting = _counting(GridMap(GridSpec(0.1, 6, 1), p[:1, ::-1].copy()), 1)
    assert counting == pytest.approx(np.array([[0.0, 0.0, -0.5, -0.5, 0.54, 0.9]]))


def test_the_range_is_kept_to(room):
    grid_map, _ = room
    ends = np.random.default_rng(1).uniform(0.0, 4.0, (50, 2))
    looked = wall_matches(grid_map, ends, 0.5, 0.2, 10)
    assert np.hypot(*looked.moves[:, :2].T).max() <= 0.5 + looked.cell_m
    assert np.abs(looked.moves[:, 2]).max() <= 0.2 + looked.turn_rad
    for a, one in enumerate(looked.moves):
        for other in looked.moves[:a]:
            off = np.abs(one - other)
            far = np.hypot(*off[:2]) > APART * looked.cell_m
            assert far or off[2] > APART * looked.turn_rad - 1e-9


def test_what_cannot_be_looked_for_is_refused(room):
    with pytest.raises(ConfigError, match='reach'):
        FrameSearch(-1.0)
    with pytest.raises(ConfigError, match='turn'):
        FrameSearch(0.0, 4.0)
    silent = [PlacedScan.at(fan(math.inf, range_max_m=5.0), Pose2D())]
    with pytest.raises(GridError, match='no beam of 1 scans returned'):
        find_frame(room[0], silent, MODEL, prior=0.15, search=FrameSearch())
