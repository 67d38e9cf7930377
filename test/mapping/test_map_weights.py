"""Poses weighed by the map so far: on paper, against a slow twin, and where nothing is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, MapperConfig, PoseUncertainConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation import beam_log_likelihood
from ogm_mcmc.geometry import (
    CellBox,
    GridMap,
    GridSpec,
    PlacedScan,
    Pose2D,
    PoseBelief,
    PoseSamples,
)
from ogm_mcmc.mapping import AdaptiveMapper, PoseUncertainMapper
from ogm_mcmc.mapping.map_weights import MOST_BEAMS, log_fits, weighted_by_map
from ogm_mcmc.sensors import ForwardModel

NAN = math.nan


class Known:
    """A map of given probabilities; says which cells it was asked for."""

    def __init__(self, probability, *, resolution=1.0, column0=0, row0=0):
        cells = np.array(probability, np.float32)
        self.spec = GridSpec(resolution, cells.shape[1], cells.shape[0], column0, row0)
        self.cells, self.asked = cells, []

    def probabilities(self, box):
        self.asked.append(box)
        return np.ascontiguousarray(self.cells[self.spec.slices(box)])


def config(beams=1.0, sigma=0.1, **settings):
    chosen = PoseUncertainConfig(map_beams=beams, map_sigma=sigma, negligible=0.0)
    return MapperConfig(**{'resolution': 1.0, 'pose_uncertain': chosen, **settings})


def cloud(*poses, weights=None):
    return PoseSamples.checked(np.array(poses, np.float64), weights)


def room(resolution=0.05, side=4.0, seen_from=(2.0, 2.0)):
    """A square room seen with a known pose, and the scan in it, of 180 beams."""
    scan = room_scan(seen_from, side)
    method = PoseUncertainMapper(
        config(10.0, resolution=resolution, method='pose_uncertain', no_return='ignore')
    )
    for _ in range(3):
        method.update(PlacedScan.at(scan, Pose2D(*seen_from, 0.0)))
    return method, scan


def room_scan(at, side):
    bearings = -math.pi + 2.0 * math.pi / 180 * np.arange(180)
    dx, dy = np.cos(bearings), np.sin(bearings)
    with np.errstate(divide='ignore'):
        to_x = np.where(dx > 0.0, side - at[0], -at[0]) / dx
        to_y = np.where(dy > 0.0, side - at[1], -at[1]) / dy
    ranges = np.minimum(np.abs(to_x), np.abs(to_y))
    return fan(*ranges, bearing=-math.pi, increment=2.0 * math.pi / 180, range_max_m=8.0)


# -- on paper -----------------------------------------------------------------------------------


def test_one_beam_and_a_wall_on_paper():
    """Reading 2: from the first pose the wall is met half way through cell 2, 2 m off; else 1 m.

    p = clutter / reach + hit * 0.9 * N(2; d, 0.5), cut off at the sensor. One beam counts as one.
    """
    walls = Known([[0.0, 0.0, 0.0, 0.9, 0.0, 0.0]])
    poses = cloud((1.5, 0.5, 0.0), (2.5, 0.5, 0.0), weights=np.array([0.25, 0.75]))
    got = weighted_by_map(poses, fan(2.0), walls, config(sigma=0.5))

    def p(distance):
        normal = math.exp(-0.5 * ((2.0 - distance) / 0.5) ** 2) / (0.5 * math.sqrt(2.0 * math.pi))
        above = 0.5 * math.erfc(-distance / 0.5 / math.sqrt(2.0))
        return 0.05 / fan(2.0).range_max_m + 0.9 * 0.9 * normal / above

    expected = np.array([0.25 * p(2.0), 0.75 * p(1.0)])
    assert got.weights == pytest.approx(expected / expected.sum(), rel=1e-6)
    assert np.array_equal(got.poses, poses.poses)


def test_a_share_of_the_beams_counts():
    """Two beams that count as one half: their likelihood to the power 1/4."""
    walls = Known([[0.0, 0.0, 0.0, 0.9]])
    poses = np.array([(1.5, 0.5, 0.0), (2.5, 0.5, 0.0)])
    scan = fan(2.0, 2.0, increment=1e-9)
    whole = log_fits(poses, scan, walls, config(2.0))
    assert log_fits(poses, scan, walls, config(0.5)) == pytest.approx(0.25 * whole)
    # No beam counts more than once.
    assert log_fits(poses, scan, walls, config(60.0)) == pytest.approx(whole)


def test_a_pose_five_centimetres_off_the_wall_loses():
    method, scan = room()
    poses = cloud((2.0, 2.0, 0.0), (2.05, 2.0, 0.0), (2.0, 2.0, 0.05))
    got = weighted_by_map(poses, scan, method, method.config)
    by_pose = dict(zip(map(tuple, got.poses.tolist()), got.weights.tolist(), strict=True))
    assert by_pose[2.0, 2.0, 0.0] > 0.6
    assert by_pose[2.05, 2.0, 0.0] < 0.3


def test_scans_from_doubtful_poses_spoil_the_map_less():
    """Eight scans from clouds 10 cm wide after three from a known place: nats a beam there."""
    nats = {}
    for beams in (0.0, 10.0):
        method, scan = room()
        chosen = replace(method.config.pose_uncertain, map_beams=beams)
        method.configure(replace(method.config, pose_uncertain=chosen))
        belief = PoseBelief(Pose2D(2.0, 2.0), np.diag([0.1, 0.1, 0.02]) ** 2)
        for _ in range(8):
            method.update(PlacedScan(scan, belief))
        found = GridMap(method.spec, method.probabilities(method.spec.box))
        here = [PlacedScan.at(scan, Pose2D(2.0, 2.0))]
        model = ForwardModel.from_config(ForwardModelConfig())
        nats[beams] = beam_log_likelihood(found, here, model).mean()
    assert nats[10.0] > nats[0.0] + 0.1


# -- a slow twin --------------------------------------------------------------------------------


@pytest.fixture
def random_case():
    rng = np.random.default_rng(5)
    probability = rng.random((24, 30)) ** 4
    probability[rng.random((24, 30)) < 0.2] = NAN
    walls = Known(probability, resolution=0.25, column0=-7, row0=3)
    poses = np.column_stack(
        (rng.uniform(-1.0, 5.0, 9), rng.uniform(1.0, 6.0, 9), rng.uniform(-3, 3, 9))
    )
    scan = fan(*rng.uniform(0.5, 4.0, 20), bearing=-2.0, increment=0.2, range_max_m=6.0)
    scan.ranges_m[[2, 5, 11]] = NAN, math.inf, 5.5
    return walls, cloud(*poses, weights=rng.random(9)), scan


def test_as_the_judge_of_held_out_beams_has_it(random_case):
    """Beams in reach one by one, unknown cells free, a power of 4 / 17; all of it by the judge."""
    walls, poses, scan = random_case
    settings = config(4.0, resolution=0.25, max_range=5.0)
    got = weighted_by_map(poses, scan, walls, settings)
    model = ForwardModel.from_config(ForwardModelConfig(sigma=0.1))
    heard = replace(scan, range_max_m=5.0)
    whole = GridMap(walls.spec, walls.cells)
    logs = np.array(
        [
            beam_log_likelihood(
                whole, [PlacedScan.at(heard, Pose2D(*pose))], model, prior=0.0, no_return='ignore'
            ).sum()
            for pose in poses.poses.tolist()
        ]
    )
    weights = poses.weights * np.exp(4.0 / 17.0 * (logs - logs.max()))
    order = np.lexsort(poses.poses.T[::-1])
    assert np.array_equal(got.poses, poses.poses[order])
    assert got.weights == pytest.approx((weights / weights.sum())[order], abs=1e-4)


def test_weights_sum_to_one_and_the_lightest_are_left_out(random_case):
    walls, poses, scan = random_case
    settings = config(17.0, resolution=0.25)
    every = weighted_by_map(poses, scan, walls, settings)
    few = weighted_by_map(
        poses,
        scan,
        walls,
        replace(settings, pose_uncertain=replace(settings.pose_uncertain, negligible=0.05)),
    )
    assert every.weights.sum() == pytest.approx(1.0)
    assert few.weights.sum() == pytest.approx(1.0)
    assert 1 <= few.weights.size < every.weights.size == 9


def test_a_particle_of_no_weight_is_left_out():
    walls = Known([[0.0, 0.0, 0.0, 0.9]])
    poses = cloud((1.5, 0.5, 0.0), (2.5, 0.5, 0.0), weights=np.array([0.0, 1.0]))
    assert weighted_by_map(poses, fan(2.0), walls, config()).poses[:, 0].tolist() == [2.5]


# -- what is asked of the map -------------------------------------------------------------------


def test_only_the_cells_that_beams_cross_are_looked_at():
    """From x = 20.5 a beam of 3 m and six sigma, 0.6 m, to the right; the map is 1 000 wide."""
    walls = Known(np.zeros((40, 1000)))
    poses = cloud((20.5, 9.5, 0.0), (21.5, 10.5, 0.0))
    weighted_by_map(poses, fan(3.0), walls, config())
    assert walls.asked == [CellBox(20, 9, 26, 11)]


def test_of_many_beams_and_poses_a_bounded_number_is_looked_at(monkeypatch):
    looked = []

    class Counting:
        def __init__(self, *_args, **_settings):
            pass

        def log_likelihoods(self, poses, bearings, ranges, reach):
            looked.append((len(poses), bearings.size, ranges.size))
            return np.zeros(len(poses))

    monkeypatch.setattr('ogm_mcmc.mapping.map_weights.ProbabilityBeams', Counting)
    walls = Known(np.zeros((9, 9)))
    scan = fan(*np.full(700, 2.0), increment=0.001)
    for count in (2, 100, 200, 5000):
        log_fits(np.full((count, 3), 4.0), scan, walls, config())
    assert looked == [(2, MOST_BEAMS, MOST_BEAMS), (100, 30, 30), (200, 15, 15), (5000, 10, 10)]


# -- nothing known ------------------------------------------------------------------------------


def test_an_empty_map_changes_nothing():
    poses = cloud((1.5, 0.5, 0.0), (2.5, 0.5, 0.3), weights=np.array([0.3, 0.7]))
    for walls in (Known(np.full((4, 6), NAN)), Known([[0.9]], column0=500)):
        assert weighted_by_map(poses, fan(2.0), walls, config()) is poses
    # Where only other places are known, beams end in what nobody knows: all weights stay.
    probability = np.full((9, 9), NAN)
    probability[8, 8] = 0.9
    got = weighted_by_map(poses, fan(2.0, increment=0.2), Known(probability), config())
    assert got.weights.tolist() == pytest.approx([0.3, 0.7])


@pytest.mark.parametrize('method', [PoseUncertainMapper, AdaptiveMapper])
def test_the_first_scan_is_mapped_as_without_weights(method):
    belief = PoseBelief(Pose2D(2.0, 2.0), np.diag([0.1, 0.1, 0.02]) ** 2)
    maps = []
    for beams in (0.0, 10.0):
        mapper = method(config(beams, resolution=0.25))
        mapper.update(PlacedScan(room_scan((2.0, 2.0), 4.0), belief))
        maps.append(mapper.log_odds(mapper.spec.box))
    np.testing.assert_array_equal(*maps)


def test_off_one_pose_or_no_return_changes_nothing():
    walls = Known([[0.0, 0.0, 0.0, 0.9]])
    poses = cloud((1.5, 0.5, 0.0), (2.5, 0.5, 0.0))
    assert weighted_by_map(poses, fan(2.0), walls, config(0.0)) is poses
    assert weighted_by_map(poses, fan(math.inf, NAN), walls, config()) is poses
    assert weighted_by_map(poses, fan(2.0), walls, config(max_range=1.0)) is poses
    one = cloud((1.5, 0.5, 0.0))
    assert weighted_by_map(one, fan(2.0), walls, config()) is one
    assert walls.asked == []


def test_a_pose_absurdly_far_away_is_left_to_the_mapper():
    poses = cloud((1.5, 0.5, 0.0), (1e30, 0.5, 0.0))
    walls = Known([[0.0, 0.0, 0.0, 0.9]])
    assert weighted_by_map(poses, fan(2.0), walls, config()) is poses
    endless = replace(fan(2.0), range_max_m=math.inf)
    with pytest.raises(GridError, match='range_max'):
        weighted_by_map(poses, endless, walls, config())


# -- in the methods -----------------------------------------------------------------------------


@pytest.mark.parametrize('method', [PoseUncertainMapper, AdaptiveMapper])
def test_methods_map_at_the_weighted_samples(method, monkeypatch):
    """The second of two equal scans is mapped at the pose of the first alone."""
    monkeypatch.setattr('ogm_mcmc.mapping.map_weights.MOST_LOOKS', 10**6)
    scan = room_scan((2.0, 2.0), 4.0)
    particles = cloud((2.0, 2.0, 0.0), (2.3, 2.0, 0.0))
    doubtful = PlacedScan(scan, PoseBelief(particles.mean(), None, particles))
    known = PlacedScan.at(scan, Pose2D(2.0, 2.0))
    chosen = PoseUncertainConfig(map_beams=60.0, negligible=0.01)
    maps = []
    for last in (doubtful, known):
        mapper = method(MapperConfig(resolution=0.1, pose_uncertain=chosen))
        mapper.update(known)
        mapper.update(last)
        maps.append(mapper.log_odds(mapper.spec.box))
    np.testing.assert_array_equal(*maps)


def test_the_samples_of_the_last_scan_are_kept():
    method, scan = room()
    particles = cloud((2.0, 2.0, 0.0), (2.3, 2.0, 0.0))
    method.update(PlacedScan(scan, PoseBelief(particles.mean(), None, particles)))
    assert method.samples.mean().x_m < 2.05
    method.reset()
    assert method.samples is None
