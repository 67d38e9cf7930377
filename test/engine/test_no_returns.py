import numpy as np
import pytest

from ogm_mcmc.engine.no_returns import KEPT, NoReturns, NoReturnWatch
from ogm_mcmc.geometry import PlacedScan, Pose2D, Scan

REACH = 6.0


def scan_at(x, lost):
    """A wall at x = 4 over the middle beams, nothing beyond the others; some hits are lost."""
    bearings = np.linspace(-1.5, 1.5, 61)
    ranges = np.full(61, np.inf)
    ahead = np.abs(bearings) < 0.6
    ranges[ahead] = (4.02 - x) / np.cos(bearings[ahead])
    ranges[lost] = np.inf
    scan = Scan.checked(
        ranges,
        angle_min_rad=-1.5,
        angle_increment_rad=0.05,
        range_min_m=0.1,
        range_max_m=REACH,
    )
    return PlacedScan.at(scan, Pose2D(x))


def judged(lost_of, count=10):
    watch = NoReturnWatch(0.1)
    for k in range(count):
        watch.see(scan_at(0.02 * k, lost_of(k)))
    return watch.judge()


def test_beams_into_the_open_cross_nothing():
    found = judged(lambda k: [])
    assert found.beams == 10 * 38
    assert found.crossing == 0
    assert not found.doubtful


def test_beams_that_lost_the_wall_cross_it():
    """Every other beam on the wall is lost, others in the next scan; those at the rim are few."""
    found = judged(lambda k: range(20 + k % 2, 42, 2))
    lost = found.beams - 10 * 38
    assert lost > 80
    assert found.crossing == pytest.approx(lost, abs=12)


def test_what_is_said():
    most = NoReturns(100, 87)
    assert most.doubtful
    assert str(most).startswith('87% of the beams without a return cross cells')
    assert not NoReturns(10, 10).doubtful
    assert not NoReturns(100, 40).doubtful
    assert NoReturns(0, 0).share == 0.0


def test_no_more_is_kept_of_a_long_recording():
    watch = NoReturnWatch(0.1)
    for k in range(10 * KEPT):
        watch.see(scan_at(0.001 * k, []))
    assert KEPT <= len(watch._kept) < 2 * KEPT
    assert watch._kept[0].pose.x_m == 0.0
    assert watch._kept[-1].pose.x_m > 0.0009 * 10 * KEPT
