"""What is believed, a random covariance, Fig. 2, and a short exploration mapped three times."""

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.experiments import pose_sim
from ogm_mcmc.geometry import Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.plotting.grids import BOTTOM, LEFT, LEGEND, RIGHT, TOP


def test_likeliest_particle():
    samples = PoseSamples.checked(
        np.array([(0.0, 0.0, 0.0), (1.0, 2.0, 0.5), (3.0, 0.0, 0.0)]), np.array([0.3, 0.4, 0.3])
    )
    belief = PoseBelief(samples.mean(), samples.covariance(), samples)
    assert pose_sim.likeliest(belief) == Pose2D(1.0, 2.0, 0.5)


def test_random_covariances_are_covariances_within_bounds():
    rng = np.random.default_rng(1)
    largest = np.array([pose_sim.LARGEST_SPREAD_M] * 2 + [pose_sim.LARGEST_SPREAD_RAD])
    correlated = 0
    for _ in range(50):
        covariance = pose_sim.covariance_of(rng)
        assert np.allclose(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance).min() > 0.0
        spread = np.sqrt(np.diag(covariance))
        assert (spread <= largest).all()
        assert (spread >= 0.19 * largest).all()
        correlated += abs(covariance[0, 1]) > 0.1 * spread[0] * spread[1]
    assert correlated > 10


@pytest.mark.jit
def test_short_exploration(monkeypatch):
    monkeypatch.setattr(pose_sim, 'MAX_STOPS', 6)
    result = pose_sim.score(9, 1, which='poor filter', seed=2)
    assert result['scans'] == 6
    assert 0.0 < result['error_m'] < 1.0
    assert 0.0 < result['claimed_m'] < 1.0
    areas = {name: pose_sim.pooled([part]).roc_area() for name, part in result['methods'].items()}
    assert areas[pose_sim.EXACT] > areas[pose_sim.WITHOUT] > 0.7
    again = pose_sim.score(9, 1, which='poor filter', seed=2)
    assert again == result


@pytest.mark.jit
def test_figure_2_spreads_what_is_known(tmp_path):
    rows, pictures = pose_sim.figure_2(tmp_path, seed=1)
    exact, uncertain = (line['ours'] for line in rows)
    # Every cell of the ideal model is at 0.01 or 0.99.
    cells = int(rows[0]['remark'].split()[1])
    assert exact == pytest.approx(cells * 0.0560, rel=1e-3)
    assert uncertain > exact
    assert {path.name for path in tmp_path.iterdir()} == set(pictures)
    shades = {}
    for name in pictures:
        with Image.open(tmp_path / name) as picture:
            pixels = np.asarray(picture.convert('RGB')).astype(int)
        top = TOP if name == 'fig2_exact.png' else TOP + LEGEND
        inside = pixels[top + 2 : -BOTTOM - 2, LEFT + 2 : -RIGHT - 2].reshape(-1, 3)
        grey = inside.max(axis=1) == inside.min(axis=1)
        shades[name] = set(inside[grey, 0].tolist())
        assert (~grey).any() == (name != 'fig2_exact.png')  # robot, field of view, spread
    # Free, unknown, occupied, in a map as the paper shows it; much in between in the other.
    assert shades['fig2_exact.png'] == {253, 127, 1}
    assert len(shades['fig2_uncertain.png']) > 50
