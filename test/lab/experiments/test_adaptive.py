"""[pose] Fig. 4 (b): how the comparison counts, and what the paper says came out."""

import math

import numpy as np
import pytest

from ogm_mcmc.evaluation.classification import confusion_counts
from ogm_mcmc.lab.experiments import adaptive
from ogm_mcmc.lab.experiments.adaptive import agreement, roc_curve, run

NAN = math.nan


def test_agreement_by_hand():
    """Two walls, three free cells and one never measured in the regular map."""
    regular = np.array([[0.9, 0.8, 0.1, 0.2, 0.1, NAN, NAN, NAN]])
    adaptive = np.array([[0.9, 0.3, 0.1, 0.7, NAN, 0.9, 0.1, NAN]])
    truth = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, NAN]])
    found = agreement(adaptive, regular, truth)
    assert found.true_positive == 0.5
    assert found.false_positive == pytest.approx(1 / 3)
    assert found.painted == pytest.approx(2 / 5)
    assert found.painted_wrong == 0.5
    # Thresholds 0.9, 0.7, 0.5, 0.3, 0.1: (0, 1/2), (1/3, 1/2), (2/3, 1/2), (2/3, 1), (1, 1).
    assert found.counts.roc_area() == pytest.approx(2 / 3 * 0.5 + 1 / 3)


def test_a_drawn_curve_keeps_its_area():
    rng = np.random.default_rng(3)
    truth = rng.random(5000) < 0.1
    counts = confusion_counts(np.where(truth, rng.beta(5, 2, 5000), rng.beta(1, 9, 5000)), truth)
    _, x, y, _ = roc_curve('', counts)
    assert (x[0], y[0], x[-1], y[-1]) == (0.0, 0.0, 1.0, 1.0)
    area = np.sum(np.diff(x) * 0.5 * (y[1:] + y[:-1]))
    assert area == pytest.approx(counts.roc_area(), abs=1e-3)


@pytest.mark.full
def test_result(tmp_path, monkeypatch):
    """All of `--quick`, from half of its scans."""
    really = adaptive.recorded

    def fewer(world, every, seed, **options):
        return really(world, 2 * every, seed, **options)

    monkeypatch.setattr(adaptive, 'recorded', fewer)
    result = run(tmp_path, quick=True, seed=1)
    ours = {line['what']: line['ours'] for line in result['rows']}
    for case in ('office', 'office, uncertain poses'):
        for kind in ('', ', as printed'):
            with_, without = (
                ours[f'{case}: ROC area, {name} unknowns{kind}'] for name in ('with', 'w/o')
            )
            assert with_ > without
            assert with_ > 0.99
    # The finer the cells and the larger the open areas, the more the tree saves; where walls are
    # near and cells coarse it costs more than a grid.
    shares = {
        name: [ours[f'{name}, {cm:g} cm: bytes of the tree / of the grid'] for cm in (10, 5, 2.5)]
        for name in ('office', 'hall')
    }
    for name in shares:
        assert shares[name] == sorted(shares[name], reverse=True)
    assert all(
        hall < office for hall, office in zip(shares['hall'], shares['office'], strict=True)
    )
    assert shares['office'][0] > 1.0
    assert shares['hall'][2] < 0.1
    for name in result['pictures']:
        assert (tmp_path / name).stat().st_size > 500
