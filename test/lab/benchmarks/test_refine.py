"""The benchmark of refining: clocks that stand still, beams apart, figures that fit together."""

import itertools
import json
import math
import time

import numpy as np
from support.strategies import fan

from ogm_mcmc.config import ChainConfig, WindowConfig
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.lab.benchmarks.refine import (
    Clock,
    Patience,
    every_other_beam,
    recorded_office,
    time_refining,
)


def test_a_clock_stands_still_while_it_is_paused():
    clock = Clock()
    before = clock.pause()
    time.sleep(0.02)
    assert clock.seconds == before
    clock.resume()
    time.sleep(0.02)
    assert clock.seconds.wall - before.wall >= 0.02
    assert clock.seconds.cpu - before.cpu < clock.seconds.wall - before.wall


def test_every_beam_is_mapped_or_judges():
    scan = PlacedScan.at(fan(1.0, 2.0, 3.0, math.inf), Pose2D(1.0, 2.0))
    even, odd = (every_other_beam([scan], first)[0] for first in (0, 1))
    assert even.scan.ranges_m.tolist()[::2] == [1.0, 3.0]
    assert odd.scan.ranges_m.tolist()[1::2] == [2.0, math.inf]
    assert np.isnan(even.scan.ranges_m[1::2]).all()
    assert np.isnan(odd.scan.ranges_m[::2]).all()
    assert even.belief is scan.belief


def test_office_has_the_rays_that_are_promised():
    assert sum(scan.scan.ranges_m.size for scan in recorded_office()) // 1000 == 416


def test_figures_of_a_corridor_fit_together():
    """Twenty scans of three beams, of which every second one judges."""
    placed = [
        PlacedScan.at(fan(1.0, 1.02, 1.05, 1.02, 1.0, increment=0.1), Pose2D(0.02 * k, 0.0))
        for k in range(20)
    ]
    config = RefineSamplerConfig(window=WindowConfig(0.1), chain=ChainConfig(burn_in=5))
    result = time_refining(placed, config, Patience(20.0, 0.3))
    agreed, start = result['seconds_to_agreement'], result['seconds_to_start']
    assert agreed['wall'] > start['wall'] > 0.0
    assert result['agreeing_share'] >= 0.99
    assert result['rays'] == 100
    rate = result['effective_samples_per_second']['wall']
    sampled = result['effective_samples'] / (agreed['wall'] - start['wall'])
    assert math.isclose(rate, sampled, rel_tol=0.05)
    better = result['first_better']
    looks = [
        look['wall'] for look in better['refined'] if look['nats_as_shown'] > better['live_nats']
    ]
    assert better['seconds'] is None if not looks else better['seconds']['wall'] == looks[0]
    walls = [look['wall'] for look in better['refined']]
    assert all(later >= 1.2 * wall for wall, later in itertools.pairwise(walls))
    json.dumps(result)
