"""Ten buildings: different, seeded, in one piece, from cluttered to sparse, at many angles."""

import numpy as np
import pytest
from scipy import ndimage

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.simulation import FLOOR_PLANS, generate_floor

pytestmark = pytest.mark.jit


@pytest.fixture(scope='module')
def floors():
    return [generate_floor(number) for number in range(1, 11)]


def test_ten_of_them_in_one_piece(floors):
    assert len(floors) == len(FLOOR_PLANS) == 10
    for floor in floors:
        assert floor.occupied.shape == (500, 500)
        assert floor.spec.resolution_m == 0.1
        _, pieces = ndimage.label(floor.occupied == 0)
        assert pieces == 1
        assert 0.15 < floor.occupied.mean() < 0.5
        for border in (floor.occupied[0], floor.occupied[-1], floor.occupied.T[0]):
            assert border.all()


def test_from_cluttered_to_sparse(floors):
    """Share of free cells with something occupied within five cells."""
    crowded = []
    for floor in floors:
        free = floor.occupied == 0
        gap = ndimage.distance_transform_edt(free)
        crowded.append(float((gap[free] <= 5).mean()))
    assert np.corrcoef(crowded, np.arange(10))[0, 1] < -0.9
    assert crowded[0] > 2.5 * crowded[-1]


def test_walls_run_at_many_angles(floors):
    """Directions of the walls' borders: axis-parallel walls alone would have four."""
    for floor in floors:
        smooth = ndimage.gaussian_filter(floor.occupied.astype(float), 3.0)
        dy, dx = np.gradient(smooth)
        strong = np.hypot(dx, dy) > 0.05
        turn = np.degrees(np.arctan2(dy, dx)[strong]) % 90.0
        askew = (turn > 4.0) & (turn < 86.0)
        assert askew.mean() > 0.1


@pytest.mark.jit
@pytest.mark.parametrize('seed', [0, 1, 2])
def test_a_robot_gets_nearly_everywhere(seed):
    """With a radius of 2.5 cells; what it cannot enter it can still look into."""
    for number in (1, 3, 6):
        free = generate_floor(number, seed).occupied == 0
        room = ndimage.distance_transform_edt(free) > 2.5
        labels, _ = ndimage.label(room)
        sizes = np.bincount(labels.ravel())[1:]
        assert sizes.max() > 0.97 * sizes.sum()


def test_seeds(floors):
    assert np.array_equal(generate_floor(4).occupied, floors[3].occupied)
    assert (generate_floor(4, seed=1).occupied != floors[3].occupied).mean() > 0.05
    with pytest.raises(ConfigError, match='building'):
        generate_floor(11)
