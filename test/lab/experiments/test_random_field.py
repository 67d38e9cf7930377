"""[field] Fig. 2 to 5: what the paper's text says of its pictures."""

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.lab.experiments.random_field import corridor, observations, roughness, run
from ogm_mcmc.plotting.grids import LEFT, TOP
from ogm_mcmc.plotting.images import UNKNOWN_COLOUR
from ogm_mcmc.simulation import true_ranges


def test_the_door_is_open_and_the_corridor_is_not():
    from ogm_mcmc.geometry import Pose2D

    up = np.array([np.pi / 2])
    walls = corridor().walls
    assert true_ranges(walls, Pose2D(5.5, 5.5), up)[0] == pytest.approx(3.0)
    assert true_ranges(walls, Pose2D(15.5, 5.5), up)[0] == pytest.approx(11.0)


def test_observations_are_sums_of_nine_and_minus_seven():
    seen = observations(seed=4)
    values = seen.log_odds[np.isfinite(seen.log_odds)]
    sums = {9 * hits - 7 * misses for hits in range(40) for misses in range(80)}
    assert set(values.tolist()) <= sums
    # Up to nine cells in front, at right angles to the wall, and into the room behind the door.
    assert np.isfinite(seen.log_odds[5, 2:29]).all()
    assert (seen.log_odds[8, 5:13] > 0).sum() >= 6
    assert (seen.log_odds[9:13, 15] < 0).all()


def test_roughness_by_hand():
    assert roughness(np.array([[0.0, 3.0], [4.0, 4.0]])) == pytest.approx(
        np.sqrt((9 + 0 + 16 + 1) / 4)
    )


def test_result(tmp_path):
    result = run(tmp_path, quick=True, seed=2)
    ours = {line['what']: line['ours'] for line in result['rows']}
    errors = [float(value) for what, value in ours.items() if 'Eq. 21' in what]
    assert len(errors) == 6
    assert max(errors) < 1e-9
    # "When l is smaller [...] the prediction is more noise"; "when [sigma^2] becomes bigger, the
    # results are smoother".
    by_scale = [ours[f'l = {s:g}, sigma^2 = 0.1: roughness'] for s in (0.5, 1.0, 1.5, 2.0)]
    by_variance = [ours[f'l = 2, sigma^2 = {v:g}: roughness'] for v in (0.03, 0.1, 0.3)]
    assert by_scale == sorted(by_scale, reverse=True)
    assert by_variance == sorted(by_variance, reverse=True)
    for name in result['pictures']:
        assert (tmp_path / name).stat().st_size > 1000
    # Walls, far from the outliers of sixty nats in the middle of the corridor, are seen as such.
    seen = observations(2, 2.0).log_odds
    with Image.open(tmp_path / 'fig3.png') as picture:
        pixels = np.asarray(picture.convert('RGB')).astype(int)
    middles = (TOP + 10 * np.arange(18)[::-1] + 5)[:, None], LEFT + 10 * np.arange(30) + 5
    red, _, blue = np.moveaxis(pixels[middles], 2, 0)
    assert np.nanmax(np.abs(seen)) > 50.0
    assert (red - blue)[seen == 9.0].min() > 50
    assert (blue - red)[seen == -7.0].min() > 50
    assert (pixels[middles][np.isnan(seen)] == UNKNOWN_COLOUR).all()
