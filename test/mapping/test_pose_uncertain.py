"""Evidence averaged over pose samples: on paper, against a naive twin, and its limits."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.naive import beams_of, corner_margin, mean_evidence, measured_cells
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import (
    GaussianModelConfig,
    MapperConfig,
    PoseUncertainConfig,
    StepModelConfig,
)
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief, PoseSamples, cast_rays
from ogm_mcmc.geometry.pose_sampling import draw_gaussian, quasi_normals, random_normals
from ogm_mcmc.geometry.rays import cast_sampled_rays
from ogm_mcmc.geometry.traversal_kernels import sampled_beam_ends
from ogm_mcmc.mapping import PoseUncertainMapper, TwoAssumptionMapper
from ogm_mcmc.mapping.beam_evidence_kernels import sum_gaussians_per_beam, sum_steps_per_beam
from ogm_mcmc.mapping.evidence_kernels import add_evidence, sum_per_scan
from ogm_mcmc.mapping.pose_samples import pose_samples

approx = pytest.approx

L_FREE, L_OCC = -0.75, 2.0  # exact in float32, and of different size
STEP = StepModelConfig(l_free=L_FREE, l_occ=L_OCC)
FUSIONS = ['per_scan', 'per_beam']
MODELS = ['step', 'gaussian']
UNKNOWN = math.nan


def config(**settings):
    """Cells of 1 m, unless said otherwise."""
    return MapperConfig(
        **{'method': 'pose_uncertain', 'resolution': 1.0, 'step': STEP, **settings}
    )


def mapper(**settings):
    return PoseUncertainMapper(config(**settings))


def cloud(*rows):
    """A belief of (x, y, yaw, weight)."""
    table = np.array(rows, np.float64)
    samples = PoseSamples.checked(table[:, :3], table[:, 3])
    return PoseBelief(samples.mean(), samples.covariance(), samples)


def row_of(method, length=8):
    box = CellBox(0, 0, length, 1)
    method.grid.cover(box)
    return method.log_odds(box)[0].tolist()


def measured(method):
    return measured_cells(method.log_odds(method.spec.box), method.spec.box)


def office_scan(beams=90, seed=3):
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(1.0, 5.0, beams)
    ranges[::9] = math.inf
    return fan(*ranges, bearing=-3.0, increment=2.0 * math.pi / beams, range_max_m=6.0)


def placed_scans(count=6):
    rng = np.random.default_rng(11)
    return [
        (office_scan(seed=k), Pose2D(*rng.uniform(-2.0, 2.0, 2), rng.uniform(-3.0, 3.0)))
        for k in range(count)
    ]


# -- on paper -----------------------------------------------------------------------------------


@pytest.mark.parametrize('fusion', FUSIONS)
def test_two_places_in_a_corridor_on_paper(fusion):
    """The wall is in cell 4 (weight 3/4) or, if the robot is 2 m further, in cell 6 (1/4)."""
    method = mapper(fusion=fusion)
    changed = method.update(
        PlacedScan(fan(4.0), cloud((0.5, 0.5, 0.0, 0.75), (2.5, 0.5, 0.0, 0.25)))
    )
    assert changed == CellBox(0, 0, 7, 1)
    expected = [
        *([0.75 * L_FREE] * 2 + [L_FREE] * 2),
        *(0.75 * L_OCC + 0.25 * L_FREE, 0.25 * L_FREE, 0.25 * L_OCC, UNKNOWN),
    ]
    assert row_of(method) == approx(expected, nan_ok=True)


def test_a_hit_beats_a_miss_within_a_sample_not_across_samples():
    """In one place both beams end in cell 3, or pass it: 1/2 hit and 1/2 miss."""
    method = mapper()
    method.update(PlacedScan(fan(3.0, 5.0), cloud((0.5, 0.5, 0.0, 0.5), (1.5, 0.5, 0.0, 0.5))))
    assert row_of(method)[3] == 0.5 * L_OCC + 0.5 * L_FREE


def test_a_cell_whose_evidence_cancels_is_measured():
    method = mapper(step=StepModelConfig(l_free=-1.0, l_occ=1.0))
    method.update(PlacedScan(fan(3.0), cloud((0.5, 0.5, 0.0, 0.5), (1.5, 0.5, 0.0, 0.5))))
    assert row_of(method) == approx([-0.5, -1, -1, 0.0, 0.5, *[UNKNOWN] * 3], nan_ok=True)


def test_prior_counts_once_and_limits_hold():
    method = mapper(prior=0.2, log_odds_limit=3.0)
    belief = cloud((0.5, 0.5, 0.0, 0.5), (1.5, 0.5, 0.0, 0.5))
    method.update(PlacedScan(fan(3.0), belief))
    assert row_of(method)[2] == approx(math.log(0.25) + L_FREE)
    for _ in range(9):
        method.update(PlacedScan(fan(3.0), belief))
    assert row_of(method)[:5] == approx([-3.0, -3.0, -3.0, 3.0, 3.0])


def test_gaussian_corridor_against_the_formula():
    gaussian = GaussianModelConfig(sigma=0.5, width=1.0, l_min=-2.0, l_max=2.0)
    method = TwoAssumptionMapper(
        MapperConfig(resolution=1.0, inverse_model='gaussian', gaussian=gaussian)
    )
    method.update(PlacedScan.at(fan(4.0), Pose2D(0.5, 0.5)))

    def phi(x):
        return 0.5 * math.erfc(-x / math.sqrt(2.0))

    expected = []
    for distance in range(6):
        g = phi((distance - 4 + 0.5) / 0.5) - phi((distance - 4 - 0.5) / 0.5) / 2
        expected.append(min(max(math.log(g / (1 - g)), -2.0), 2.0))
    assert row_of(method)[:6] == approx(expected, abs=1e-3)
    assert np.isnan(row_of(method)[7])


# -- the same as the known pose -----------------------------------------------------------------


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('fusion', FUSIONS)
@pytest.mark.parametrize('kind', ['mean', 'zero covariance', 'one particle', 'copies'])
def test_one_pose_is_the_known_pose_bit_for_bit(model, fusion, kind):
    chosen = {'fusion': fusion, 'inverse_model': model, 'resolution': 0.1}
    known, uncertain = TwoAssumptionMapper(config(**chosen)), mapper(**chosen)
    for scan, pose in placed_scans():
        row = np.array([[pose.x_m, pose.y_m, pose.yaw_rad]])
        belief = {
            'mean': PoseBelief(pose),
            'zero covariance': PoseBelief(pose, np.zeros((3, 3))),
            'one particle': PoseBelief(pose, None, PoseSamples.checked(row)),
            'copies': PoseBelief(pose, None, PoseSamples.checked(np.repeat(row, 30, axis=0))),
        }[kind]
        assert known.update(PlacedScan.at(scan, pose)) == uncertain.update(
            PlacedScan(scan, belief)
        )
    box = known.spec.box
    assert uncertain.spec.box == box
    assert np.array_equal(known.log_odds(box), uncertain.log_odds(box), equal_nan=True)


def test_the_averaging_kernel_itself_gives_the_same_bits():
    """Not only because one sample takes the way of the known pose."""
    known, uncertain = TwoAssumptionMapper(config(resolution=0.1)), mapper(resolution=0.1)
    for scan, pose in placed_scans():
        known.update(PlacedScan.at(scan, pose))
        row = np.array([[pose.x_m, pose.y_m, pose.yaw_rad]])
        uncertain.update_over(scan, PoseSamples(row, np.ones(1)))
    box = known.spec.box
    assert np.array_equal(known.log_odds(box), uncertain.log_odds(box), equal_nan=True)


def test_sampled_rays_are_the_rays_of_each_sample():
    table = np.random.default_rng(5).uniform(-3.0, 3.0, (7, 3))
    scan, spec = office_scan(), mapper(resolution=0.1).spec
    sampled = cast_sampled_rays(scan, table, spec)
    boxes = []
    for k, row in enumerate(table.tolist()):
        rays = cast_rays(scan, Pose2D(*row), spec)
        count = rays.n_rays
        assert sampled.n_rays == count
        assert sampled.cells[k].tolist() == [rays.column, rays.row]
        assert sampled.places[k].tolist() == [rays.x, rays.y]
        assert np.array_equal(sampled.ends[k, :, :count], rays.ends[:, :count])
        assert np.array_equal(sampled.hit[:count], rays.hit[:count])
        assert tuple(sampled.boxes[k].tolist()) == rays.box
        boxes.append(rays.box)
    union = boxes[0]
    for box in boxes[1:]:
        union = union.union(box)
    assert sampled.box == union


def test_converges_to_the_known_pose_as_the_covariance_vanishes():
    scan, pose = office_scan(), Pose2D(0.513, 0.217, 0.3)
    known = TwoAssumptionMapper(config(resolution=0.1))
    known.update(PlacedScan.at(scan, pose))
    box, errors = CellBox(-64, -64, 128, 128), []
    known.grid.cover(box)
    for scale in (1e-1, 1e-2, 1e-3, 1e-5):
        method = mapper(resolution=0.1)
        method.grid.cover(box)
        method.update(PlacedScan(scan, PoseBelief(pose, np.eye(3) * scale**2)))
        difference = np.nan_to_num(method.log_odds(box)) - np.nan_to_num(known.log_odds(box))
        errors.append(float(np.abs(difference).mean()))
    assert errors == sorted(errors, reverse=True)
    # What remains is float32 rounding of a sum of 100 equal weights.
    assert errors[-1] < 1e-5


# -- against the twin ---------------------------------------------------------------------------

# Beside the borders of cells, where kernel and twin must agree in every cell.
samples = st.lists(
    st.tuples(
        poses(2.0).map(lambda p: (p.x_m + 0.0123, p.y_m + 0.0171, p.yaw_rad)),
        st.one_of(st.floats(0.05, 1.0), st.sampled_from([0.25, 0.5])),
    ),
    min_size=2,
    max_size=7,
).map(lambda rows: PoseSamples.checked([pose for pose, _ in rows], np.array([w for _, w in rows])))


def near_a_border(scan, samples, chosen):
    """Whether rounding may decide which cell an end is in, or which corner a beam passes."""
    for pose in samples.poses.tolist():
        for beam in beams_of(scan, Pose2D(*pose), chosen):
            ends = [abs(value - round(value)) for value in beam[:4]]
            if min(corner_margin(*beam[:4]), *ends) < 1e-7:
                return True
    return False


@pytest.mark.parametrize('fusion', FUSIONS)
@given(scan=scans(), samples=samples, no_return=st.sampled_from(['clear', 'ignore']))
@settings(REPEATABLE, max_examples=60)
def test_step_evidence_equals_the_naive_mean(fusion, scan, samples, no_return):
    chosen = config(fusion=fusion, resolution=0.1, no_return=no_return, max_range=4.0)
    assume(not near_a_border(scan, samples, chosen))
    method = PoseUncertainMapper(chosen)
    method.update_over(scan, samples)
    expected, found = mean_evidence(scan, samples, chosen), measured(method)
    assert set(found) == set(expected)
    assert [found[cell] for cell in expected] == approx(list(expected.values()), abs=1e-4)


@pytest.mark.parametrize('growth', [0.0, 0.05])
@pytest.mark.parametrize('fusion', FUSIONS)
@given(scan=scans(), samples=samples)
@settings(REPEATABLE, max_examples=40)
def test_gaussian_evidence_equals_the_naive_mean(fusion, growth, scan, samples):
    gaussian = GaussianModelConfig(sigma=0.07, sigma_growth=growth, width=0.3)
    chosen = config(
        fusion=fusion, resolution=0.1, max_range=4.0, inverse_model='gaussian', gaussian=gaussian
    )
    assume(not near_a_border(scan, samples, chosen))
    method = PoseUncertainMapper(chosen)
    method.update_over(scan, samples)
    expected, found = mean_evidence(scan, samples, chosen), measured(method)
    # The split of a ray into a flat and a special part may round a corner otherwise.
    cells = set(found) & set(expected)
    assert len(cells) >= 0.98 * len(set(found) | set(expected))
    wrong = [cell for cell in cells if abs(found[cell] - expected[cell]) > 2e-3]
    assert len(wrong) <= 0.02 * len(cells)


@given(scan=scans(), samples=samples)
@settings(REPEATABLE, max_examples=40)
def test_evidence_is_linear_in_the_weights(scan, samples):
    """A mixture of two clouds gives the mixture of their evidence."""
    one, other = mapper(resolution=0.1), mapper(resolution=0.1)
    both = mapper(resolution=0.1)
    half = samples.weights.size // 2
    parts = [slice(0, half), slice(half, None)]
    for method, part in zip((one, other), parts, strict=True):
        poses, weights = samples.poses[part].copy(), samples.weights[part].copy()
        method.update_over(scan, PoseSamples(poses, weights))
    both.update_over(scan, samples)
    a, b, total = measured(one), measured(other), measured(both)
    assert set(total) == set(a) | set(b)
    for cell, value in total.items():
        assert value == approx(a.get(cell, 0.0) + b.get(cell, 0.0), abs=1e-5)


# -- the map around it --------------------------------------------------------------------------


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('fusion', FUSIONS)
def test_a_map_that_grew_equals_one_that_was_large_from_the_start(fusion, model):
    few = PoseUncertainConfig(samples=10)
    chosen = {'fusion': fusion, 'inverse_model': model, 'resolution': 0.1, 'pose_uncertain': few}
    grown, large = mapper(**chosen), mapper(**chosen)
    large.grid.cover(CellBox(-1100, -1100, 1300, 1200))
    rng = np.random.default_rng(2)
    for scan, _ in placed_scans(8):
        pose = Pose2D(*rng.uniform(-40.0, 40.0, 2), 0.3)
        belief = PoseBelief(pose, np.diag([0.01, 0.02, 0.001]))
        assert grown.update(PlacedScan(scan, belief)) == large.update(PlacedScan(scan, belief))
    box = grown.spec.box
    assert np.array_equal(grown.log_odds(box), large.log_odds(box), equal_nan=True)
    assert measured(grown) == measured(large)


@pytest.mark.parametrize('model', MODELS)
def test_nothing_is_left_in_the_scratch_memory(model):
    method = mapper(
        inverse_model=model, resolution=0.1, pose_uncertain=PoseUncertainConfig(samples=10)
    )
    for scan, pose in placed_scans():
        method.update(PlacedScan(scan, PoseBelief(pose, np.diag([0.01, 0.02, 0.001]))))
        window = method._window
        bits = (window.seen, window.free, window.special, window.misses, window.hits)
        for array in (window.evidence, *bits):
            assert not array.any()


def test_a_belief_too_far_away_is_refused_and_changes_nothing():
    method = mapper(max_cells=8192)
    method.update(PlacedScan.at(fan(4.0), Pose2D(0.5, 0.5)))
    before, spec = measured(method), method.spec
    with pytest.raises(GridError, match='would grow'):
        method.update(PlacedScan(fan(4.0), cloud((0.5, 0.5, 0.0, 0.5), (900.5, 0.5, 0.0, 0.5))))
    assert measured(method) == before
    assert method.spec == spec


def test_a_scan_that_says_nothing_changes_nothing():
    method = mapper()
    assert method.update(PlacedScan(fan(math.nan), cloud((1, 2, 3, 0.5), (2, 2, 3, 0.5)))).empty
    assert measured(method) == {}


def test_draws_are_the_same_after_a_reset_and_for_the_same_seed_only():
    belief = PoseBelief(Pose2D(0.5, 0.5), np.diag([0.04, 0.04, 0.01]))

    def drawn(method):
        placed = PlacedScan(office_scan(), belief)
        return pose_samples(placed, method.config.pose_uncertain, method._rng).poses

    method = mapper()
    first, second = drawn(method), drawn(method)
    assert not np.array_equal(first, second)
    method.reset()
    assert np.array_equal(drawn(method), first)
    other = mapper(pose_uncertain=PoseUncertainConfig(seed=2))
    assert not np.array_equal(drawn(other), first)


def test_accuracy_chooses_the_number_of_draws_with_the_range():
    """s^2 = 0.01 + 25 * 0.0004 at the longest finite range of 5 m; (1.96 s / 0.05)^2 = 30.7."""
    chosen = PoseUncertainConfig(samples=500, accuracy=0.05)
    belief = PoseBelief(Pose2D(), np.diag([0.01, 0.005, 0.0004]))
    placed = PlacedScan(fan(2.0, 5.0, math.inf), belief)
    assert pose_samples(placed, chosen, np.random.default_rng(1)).weights.size == 31


@pytest.mark.jit
def test_evenly_spread_draws_are_worth_more_in_the_map_than_random_ones():
    """Mean square error of the evidence at 100 draws against 20 000: less than two thirds."""
    scan, pose, covariance = office_scan(180), Pose2D(), np.diag([0.05, 0.05, 0.02]) ** 2
    box = CellBox(-128, -128, 192, 192)

    def evidence(count, seed, normals):
        method = mapper(resolution=0.05)
        method.grid.cover(box)
        drawn = draw_gaussian(pose, covariance, count, np.random.default_rng(seed), normals)
        method.update_over(scan, drawn)
        return np.nan_to_num(method.log_odds(box))

    truth = evidence(20_000, 99, random_normals)
    error = {
        normals: np.mean([np.mean((evidence(100, k, normals) - truth) ** 2) for k in range(6)])
        for normals in (random_normals, quasi_normals)
    }
    assert error[quasi_normals] < error[random_normals] * 2.0 / 3.0


@pytest.mark.jit
def test_one_specialization_of_each_kernel():
    belief = PoseBelief(Pose2D(0.5, 0.5), np.diag([0.04, 0.04, 0.01]))
    for fusion in FUSIONS:
        for model in MODELS:
            for change in ({}, {'resolution': 1, 'max_range': 5, 'no_return': 'ignore'}):
                chosen = {'fusion': fusion, 'inverse_model': model, **change}
                mapper(**chosen).update(PlacedScan(office_scan(), belief))
                mapper(**chosen).update(
                    PlacedScan(office_scan().flipped(), cloud((1, 2, 3, 0.5), (2, 2, 3, 0.5)))
                )
    kernels = (sum_per_scan, sum_steps_per_beam, sum_gaussians_per_beam)
    for kernel in (sampled_beam_ends, *kernels, add_evidence):
        assert len(kernel.signatures) == 1, (kernel.__name__, kernel.signatures)
