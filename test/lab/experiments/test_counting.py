"""The example of the slides: the mapper's own numbers against the closed form."""

import math

import numpy as np
import pytest

from ogm_mcmc.lab.experiments.counting import (
    occupancy_after_each_beam,
    reflection_after_each_beam,
    run,
)
from ogm_mcmc.mapping import CountingMapper


def test_occupancy_goes_with_eleven_ninths():
    ends = np.array([True, True, True, False, False] * 4)
    values = occupancy_after_each_beam(ends)
    odds = values / (1.0 - values)
    assert odds[4::5] == pytest.approx([(11 / 9) ** n for n in (1, 2, 3, 4)], rel=1e-5)
    assert odds[2] == pytest.approx((11 / 9) ** 3, rel=1e-5)


def test_the_counting_mapper_counts(monkeypatch):
    """What comes out is the running share to the last digit, and it is the mapper that counts."""
    updates = []
    update = CountingMapper.update
    monkeypatch.setattr(
        CountingMapper, 'update', lambda *given: updates.append(given) or update(*given)
    )
    ends = np.random.default_rng(2).random(300) < 0.3
    shares = reflection_after_each_beam(ends)
    assert np.array_equal(shares, np.cumsum(ends) / np.arange(1, 301))
    assert len(updates) == 300


def test_result(tmp_path):
    result = run(tmp_path, quick=True, seed=3)
    ours = {line['what']: line['ours'] for line in result['rows']}
    assert ours['reflection map'] == 0.6
    assert ours['occupancy grid'] == pytest.approx(ours['the same in closed form'], abs=1e-6)
    # 99 to 1 is reached when one kind of beam leads by log(99) / log(11/9), at the earliest.
    assert ours['beams until the occupancy grid says 0.99'] >= math.log(99) / math.log(11 / 9)
    assert (tmp_path / 'counting.png').stat().st_size > 1000
