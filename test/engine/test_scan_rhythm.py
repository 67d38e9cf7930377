"""Scans that never came are told by the stamps of those that did."""

import numpy as np

from ogm_mcmc.engine.scan_rhythm import NEVER_CAME, ScanRhythm

PERIOD_NS = 25_000_000


def count(stamps_ns):
    rhythm = ScanRhythm()
    said = sum(rhythm.add('laser', int(stamp)) for stamp in stamps_ns)
    assert said == rhythm.missed[NEVER_CAME]
    return said


def steady(n):
    return np.arange(n) * PERIOD_NS


def test_each_scan_that_is_missing_counts_once():
    kept = np.ones(400, bool)
    kept[[60, 61, 62, 130]] = False
    kept[200:250] = False
    assert count(steady(400)[kept]) == 54


def test_nothing_is_missing_where_stamps_only_jitter():
    jitter = np.random.default_rng(1).normal(0.0, 0.1 * PERIOD_NS, 400)
    assert count(steady(400) + jitter) == 0


def test_one_of_ten_lost_at_random_is_counted():
    kept = np.random.default_rng(2).random(2000) > 0.1
    lost = np.count_nonzero(~kept)
    assert abs(count(steady(2000)[kept]) - lost) <= 0.03 * lost


def test_stamps_in_bursts_have_no_rhythm():
    gaps = np.random.default_rng(3).exponential(PERIOD_NS, 400)
    assert count(np.cumsum(gaps)) == 0


def test_a_pause_is_no_loss():
    assert count(np.concatenate([steady(100), steady(100) + 20_000_000_000])) == 0


def test_a_clock_that_jumps_back_is_no_loss():
    assert count(np.concatenate([steady(100), steady(100)])) == 0


def test_two_sensors_have_their_own_rhythms():
    rhythm = ScanRhythm()
    for stamp in steady(100):
        rhythm.add('front', int(stamp))
        rhythm.add('rear', int(stamp) + 7_000_000)
    assert not rhythm.missed
    assert rhythm.add('rear', 103 * PERIOD_NS + 7_000_000) == 3
