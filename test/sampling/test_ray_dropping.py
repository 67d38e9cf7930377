"""An index that scans were taken out of, against one that they never came into."""

import math
import sys

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import CellModel, RayWindow
from ogm_mcmc.sampling.ray_index_kernels import NEAR

approx = pytest.approx

MODELS = {
    'beam': ForwardModelConfig(sigma=0.1),
    'gaussian': ForwardModelConfig(kind='gaussian', sigma=0.3),
}
REACH_M = 5.0


def scans_of(count, seed, stands=()):
    """Scans on a walk, some readings lost; those of a stand (first, end) share a pose."""
    rng = np.random.default_rng(seed)
    placed = []
    for number in range(count):
        ranges = rng.uniform(0.5, 4.0, 24)
        ranges[rng.random(24) < 0.1] = math.inf
        pose = Pose2D(0.4 * number + rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(-3, 3))
        for first, end in stands:
            if first < number < end:
                pose, ranges = placed[first].pose, 2.0 + rng.normal(0.0, 0.05, 24)
        scan = fan(*ranges, bearing=-3.0, increment=0.26, range_max_m=REACH_M)
        placed.append(PlacedScan.at(scan, pose))
    return placed


def window_of(parts, model, limits=None):
    config = WindowConfig(resolution=0.2)
    window = RayWindow(config, model, merge=True, margin=3, limits=limits)
    for part in parts:
        window.add(part)
    return window


def but(scans, gone):
    """Those of the scans that are not gone."""
    names = set(map(id, gone))
    return [one for one in scans if id(one) not in names]


def same_scans(some, others):
    return list(map(id, some)) == list(map(id, others))


def same_arrays(one, other):
    for name, a, b in zip(one._fields, one, other, strict=True):
        assert a.dtype == b.dtype, name
        assert np.array_equal(a, b), name


@pytest.mark.parametrize('kind', MODELS)
def test_what_is_left_is_the_index_of_the_other_scans(kind):
    """Also where the window becomes smaller, every list of some cells goes, and it grows again."""
    scans = scans_of(38, seed=1)
    window = window_of([scans[:30]], MODELS[kind])
    left, rng = scans[:30], np.random.default_rng(2)
    for first in (30, 34):
        gone = [left[i] for i in sorted(rng.choice(len(left), 8, replace=False))] + left[:1]
        left = but(left, gone)
        dropped = window.drop(gone)
        assert dropped.again == []
        expected = window_of([left], MODELS[kind])
        assert window.spec == expected.spec == dropped.spec
        same_arrays(window.index, expected.index)
        assert window.n_beams == expected.n_beams
        assert window.index.left_out.base is None
        new = scans[first : first + 4]
        window.add(new)
        left = left + new
    expected = window_of([left], MODELS[kind])
    same_arrays(window.index, expected.index)
    assert (window.spec, window._size) == (expected.spec, expected._size)


def naive_told(index):
    """Cells that some ray tells of, ray by ray."""
    told = np.zeros(index.n_cells, np.bool_)
    for n in range(index.n_rays):
        cells, _, _ = index.ray(n)
        told[cells[: index.telling[n]]] = True
    return told


def naive_gains(index):
    """What rays can add to cells, ray by ray."""
    most = np.zeros(index.n_cells)
    for n in range(index.n_rays):
        cells, values, unseen = index.ray(n)
        behind = np.minimum.accumulate(np.append(values, unseen)[::-1])[::-1][1:]
        most[cells] += np.maximum(values.astype(float) - behind, 0.0)
    return most


def test_cells_that_no_ray_tells_of_any_more_are_named():
    scans = scans_of(20, seed=3)
    limits = CellBox(-40, -40, 80, 40)
    window = window_of([scans], MODELS['beam'], limits)
    before = naive_told(window.index)
    dropped = window.drop(scans[4:11])
    after = naive_told(window.index)
    untold = dropped.untold.reshape(-1)
    assert not (untold & after).any()
    assert np.array_equal(before & ~untold, after)
    assert (before & ~after).sum() > 50


def log_likelihoods(window, maps):
    model = CellModel(window.index, math.log(0.2 / 0.8), window.spec.width)
    return np.array([model.log_likelihood(model.start(cells)) for cells in maps])


@pytest.mark.parametrize('kind', MODELS)
def test_where_a_robot_stood_the_others_come_in_again(kind):
    """As likely as one by one, with the gains of a window of the remaining scans."""
    scans = scans_of(24, seed=4, stands=[(3, 9), (14, 18)])
    limits = CellBox(-40, -40, 80, 40)
    window = window_of([scans[:5], scans[5:16], scans[16:20]], MODELS[kind], limits)
    gone = [scans[5], scans[7], scans[11]]
    dropped = window.drop(gone)
    again = but(scans[3:9], gone)
    assert same_scans(dropped.again, again)
    window.add([*dropped.again, *scans[20:]])
    order = [*scans[:3], *scans[9:11], *scans[12:20]]
    expected = window_of([order[:9], order[9:], [*again, *scans[20:]]], MODELS[kind], limits)
    rng = np.random.default_rng(5)
    maps = [(rng.random(window.index.n_cells) < share).astype(np.uint8)
            for share in (0.0, 0.02, 0.1) for _ in range(3)]  # fmt: skip
    single = RayWindow(WindowConfig(resolution=0.2), MODELS[kind], limits=limits)
    single.add([*order, *again, *scans[20:]])
    likely = log_likelihoods(window, maps)
    assert likely == approx(log_likelihoods(expected, maps), rel=1e-9)
    assert likely == approx(log_likelihoods(single, maps), rel=1e-5, abs=1e-2)
    assert (window.n_beams, window.n_merged) == (expected.n_beams, expected.n_merged)
    assert window.n_merged > 60
    assert np.array_equal(window.index.crossed, expected.index.crossed)
    # Together beams can add less than each of them alone, but no less than is said.
    gains = window.index.gains()
    assert (gains <= single.index.gains() + 2.0**-14 * single.index.n_rays).all()
    assert (gains >= naive_gains(window.index) * (1.0 - 1e-6)).all()
    assert np.array_equal(gains, expected.index.gains())
    assert gains.sum() > 1000.0


def test_where_a_robot_stood_for_long_gains_stay_a_bound_and_hardly_more():
    """Beyond 1024 nats a cell grains are lost, upwards."""
    scans, limits = scans_of(312, seed=4, stands=[(3, 304)]), CellBox(-40, -40, 80, 40)
    model = ForwardModelConfig(sigma=0.03)
    window = window_of([scans], model, limits)
    assert window.index.gains().max() > 1024.0
    gone = scans[6:304]
    again = window.drop(gone).again
    assert same_scans(again, scans[3:6])
    window.add(again)
    fresh = window_of([[*scans[:3], *scans[304:]], again], model, limits)
    gains, anew = window.index.gains(), fresh.index.gains()
    assert (gains >= anew).all()
    assert gains == approx(anew, rel=0.0, abs=2e-3)
    assert np.array_equal(gains > 0.0, anew > 0.0)
    assert (gains >= naive_gains(window.index)).all()


def test_scans_of_another_window_are_refused_and_nothing_changes():
    scans = scans_of(6, seed=6)
    window = window_of([scans[:4]], MODELS['beam'])
    with pytest.raises(KeyError):
        window.drop([scans[0], scans[5]])
    same_arrays(window.index, window_of([scans[:4]], MODELS['beam']).index)


def test_a_window_that_does_not_merge_refuses_to_drop_and_holds_no_scans():
    scans = scans_of(4, seed=8)
    window = RayWindow(WindowConfig(resolution=0.2), MODELS['beam'])
    held = [sys.getrefcount(scan) for scan in scans]
    window.add(scans)
    n_beams, size = window.n_beams, window._size
    with pytest.raises(ConfigError, match='merge is False: expected True, to drop scans'):
        window.drop(scans[:1])
    assert (window.n_beams, window._size) == (n_beams, size)
    assert [sys.getrefcount(scan) for scan in scans] == held


def test_memory_stays_what_it_is_while_scans_come_and_go():
    scans = scans_of(60, seed=7, stands=[(10, 14), (30, 40)])
    window, sizes = window_of([scans[:20]], MODELS['beam']), []
    taken = scans[:20]
    coming = scans[20:] + scans[:20]
    for new in (coming[i : i + 5] for i in range(0, 60, 5)):
        dropped = window.drop(taken[:5])
        window.add([*dropped.again, *new])
        taken = [*taken[5:], *new]
        index = window.index
        assert index.near.shape[0] == index.lists[-1, NEAR]
        assert index.runs.size == index.tiles[-1]
        sizes.append(index.n_bytes / window.n_beams)
    fresh = window_of([taken], MODELS['beam']).index
    assert window.index.n_bytes < 1.1 * fresh.n_bytes
    assert max(sizes) == approx(sizes[0], rel=0.25)
