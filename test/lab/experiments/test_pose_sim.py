"""What is believed, a random covariance, Fig. 2, and a short exploration mapped three times."""

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.evaluation import confusion_counts
from ogm_mcmc.geometry import Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.lab.experiments import pose_sim
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


# Two walls and two free cells; the area under ROC is the share of pairs in the right order.
ORDERED, HALF_ORDERED, REVERSED = (0.9, 0.8, 0.2, 0.1), (0.9, 0.3, 0.6, 0.1), (0.3, 0.2, 0.6, 0.7)
SCORES = {
    ('good filter', pose_sim.WITHOUT): (HALF_ORDERED, 0.75),
    ('good filter', pose_sim.WITH): (ORDERED, 1.0),
    ('good filter', pose_sim.EXACT): (ORDERED, 1.0),
    ('poor filter', pose_sim.WITHOUT): (REVERSED, 0.0),
    ('poor filter', pose_sim.WITH): (HALF_ORDERED, 0.75),
    ('poor filter', pose_sim.EXACT): (ORDERED, 1.0),
}


def fake_score(building, run, which, seed):
    methods = {}
    for place, method in enumerate((pose_sim.WITHOUT, pose_sim.WITH, pose_sim.EXACT)):
        probability = np.array(SCORES[which, method][0])
        counts = confusion_counts(probability, np.arange(4) < 2, pose_sim.THRESHOLDS)
        methods[method] = {
            'true_positives': counts.true_positives.astype(int).tolist(),
            'false_positives': counts.false_positives.astype(int).tolist(),
            'positives': counts.positives,
            'negatives': counts.negatives,
            'brier': 0.1 * place + 0.01 * run + (0.3 if which == 'poor filter' else 0.0),
        }
    error = {2: 0.3, 5: 0.4, 8: 0.5}[building] * (2.0 if which == 'poor filter' else 1.0)
    return {'methods': methods, 'error_m': error, 'claimed_m': 0.5 * error, 'scans': 9}


@pytest.mark.jit
def test_rows_and_pictures(tmp_path, monkeypatch):
    """[pose] prints no numbers: every row is ours alone, of its own filter and method."""
    monkeypatch.setenv('OGM_MCMC_WORKERS', '1')
    monkeypatch.setattr(pose_sim, 'score', fake_score)
    monkeypatch.setattr(pose_sim, 'FIG_2_SAMPLES', 40)
    result = pose_sim.run(tmp_path, quick=True, seed=1)
    rows = {line['what']: line['ours'] for line in result['rows']}
    assert len(rows) == len(result['rows']) == 2 * (3 * 3 + 2) + 2
    assert all(line['published'] is None for line in result['rows'])
    for (which, method), (_, area) in SCORES.items():
        place = (pose_sim.WITHOUT, pose_sim.WITH, pose_sim.EXACT).index(method)
        more = 0.3 if which == 'poor filter' else 0.0
        assert rows[f'{which}, {method}: ROC area'] == pytest.approx(area)
        assert rows[f'{which}, {method}: Brier score'] == pytest.approx(0.1 * place + 0.01 + more)
        # Everything called occupied: two of four are.
        least = {1.0: 1.0, 0.75: 0.8, 0.0: 2 / 3}[area]
        assert rows[f'{which}, {method}: best F1'] == pytest.approx(least)
    root = np.sqrt(np.mean(np.square((0.3, 0.4, 0.5))))
    for which, times in (('good filter', 1.0), ('poor filter', 2.0)):
        assert rows[f'{which}: error of the likeliest pose, m'] == pytest.approx(times * root)
        assert rows[f'{which}: claimed by the particles, m'] == pytest.approx(0.5 * times * root)
    assert result['settings']['data_sets'] == 6
    assert {path.name for path in tmp_path.glob('*.png')} == set(result['pictures'])
    parts = {path.stem.rpartition('_')[0] for path in (tmp_path / 'datasets').iterdir()}
    assert parts == {
        f'map{building:02d}_run01_{which}' for building in (2, 5, 8) for which in ('good', 'poor')
    }
