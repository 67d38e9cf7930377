import math

import numpy as np
import pytest

from ogm_mcmc.engine.no_returns import (
    KEPT,
    LiveNoReturn,
    NoReturnChoice,
    NoReturns,
    NoReturnWatch,
    no_return_of,
)
from ogm_mcmc.geometry import PlacedScan, Pose2D, Scan

REACH = 6.0

NONE = NoReturns(0, 0)


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


def drive(count, *, loses, step_m=0.25):
    """Scans of a robot that goes up and down before a wall.

    Half of its beams on the endless wall are lost; or none, and many pass by the short wall.
    """
    random = np.random.default_rng(1)
    bearings = 0.05 * np.arange(-12, 13)
    scans = []
    for k in range(count):
        y = step_m * (k % 24)
        ranges = 4.02 / np.cos(bearings)
        if loses:
            ranges[random.random(25) < 0.5] = np.inf
        else:
            ranges[np.abs(y + 4.02 * np.tan(bearings)) > 1.45] = np.inf
        scan = Scan.checked(
            ranges,
            angle_min_rad=bearings[0],
            angle_increment_rad=0.05,
            range_min_m=0.1,
            range_max_m=REACH,
        )
        scans.append(PlacedScan.at(scan, Pose2D(0.0, y)))
    return scans


def test_what_is_seen_decides_where_nobody_did():
    some, most, few, none = (NoReturns(*n) for n in ((100, 40), (100, 87), (10, 0), (0, 0)))
    assert most.doubtful
    assert not NoReturns(10, 10).doubtful
    assert none.share == 0.0
    values = [NoReturnChoice.of('auto', found).value for found in (some, most, few, none)]
    assert values == ['clear', 'ignore', 'ignore', 'ignore']
    assert [NoReturnChoice.of_cones(asked).value for asked in ('auto', 'ignore')] == [
        'clear',
        'ignore',
    ]
    for asked in ('clear', 'ignore'):
        assert NoReturnChoice.of(asked, most).value == asked


def test_what_is_said():
    few, most, none = NoReturns(100, 40), NoReturns(100, 87), NoReturns(0, 0)
    crossing = '87% of the beams without a return cross cells that other beams hit'
    assert str(NoReturnChoice.of('auto', most)) == (
        f'no_return auto: ignore, {crossing} (or say no_return: clear)'
    )
    assert str(NoReturnChoice.of('auto', few)).startswith('no_return auto: clear, 40% of the')
    assert str(NoReturnChoice('clear', 'auto', most)) == (
        'no_return auto: clear was chosen from the first scans, but over all scans '
        f'{crossing}: set no_return: ignore'
    )
    assert str(NoReturnChoice.of('auto', NoReturns(7, 0))) == (
        'no_return auto: ignore, too few beams without a return to tell (7) '
        '(or say no_return: clear)'
    )
    assert str(NoReturnChoice.of('clear', most)) == (
        f'{crossing}: they clear walls; no_return: ignore keeps those'
    )
    for asked, found in (('clear', few), ('ignore', most), ('auto', none)):
        assert str(NoReturnChoice.of(asked, found)) == ''
    assert NoReturnChoice.of('auto', most).as_dict() == {
        'value': 'ignore',
        'beams': 100,
        'crossing': 0.87,
    }


def test_a_recording_is_looked_at_first():
    assert no_return_of('auto', drive(40, loses=True), 0.1).value == 'ignore'
    choice = no_return_of('auto', drive(40, loses=False), 0.1)
    assert choice.value == 'clear'
    assert choice.found.share < 0.05  # at the ends of the wall


def seen(live, scans):
    return [line for line in map(live.see, scans) if line]


def test_a_live_map_begins_careful_and_says_what_it_finds():
    live = LiveNoReturn('auto', 0.1)
    assert (live.choice.value, live.text()) == ('ignore', 'ignore for now (auto)')
    assert seen(live, drive(99, loses=False)) == []  # too few scans to be sure
    assert live.text().startswith('ignore for now (auto): ')
    (line,) = seen(live, drive(400, loses=False))
    assert line.startswith('no_return auto: clear, ')
    assert live.choice.value == 'clear'
    # Glass comes into sight: what was cleared is lost, but no more.
    (line,) = seen(live, drive(2000, loses=True))
    assert line.startswith('no_return auto: ignore, ')
    assert live.text().startswith('ignore (auto): ')


def test_a_robot_that_stands_still_does_not_know():
    live = LiveNoReturn('auto', 0.1)
    assert seen(live, drive(500, loses=False, step_m=0.0)) == []
    assert live.choice.value == 'ignore'


def test_a_live_map_that_shall_clear_says_what_it_does():
    live = LiveNoReturn('clear', 0.1)
    (line,) = seen(live, drive(120, loses=True))
    assert line.endswith('they clear walls; no_return: ignore keeps those')
    assert live.choice.value == 'clear'
    live.ask('auto', 0.0)
    assert live.choice.value == 'ignore'
    (line,) = seen(live, drive(1, loses=True))  # it looks at once
    assert line.startswith('no_return auto: ignore, ')
    live.ask('ignore', 0.0)
    assert seen(live, drive(300, loses=True)) == []


@pytest.mark.parametrize(('asked', 'looks'), [('ignore', []), ('clear', [100, 1000])])
def test_scans_do_not_wait_for_what_is_only_told(monkeypatch, asked, looks):
    """Judging takes 50 ms: seldom where it decides nothing."""
    live, at = LiveNoReturn(asked, 0.1), []
    monkeypatch.setattr(NoReturnWatch, 'judge', lambda self: at.append(self.seen) or NONE)
    for _ in range(1001):
        live.see(scan_at(0.0, []))
    assert at == looks


def test_scans_at_other_poses_are_all_that_counts():
    """Of a drifting map walls are crossed; where all is in place, they are not."""
    live = LiveNoReturn('auto', 0.1)
    seen(live, drive(120, loses=True))
    assert live.choice.found.doubtful
    live.see_anew(drive(119, loses=False))
    (line,) = seen(live, drive(120, loses=False)[-1:])  # it looks at once
    assert line.startswith('no_return auto: clear, ')


@pytest.mark.parametrize('reach', [math.inf, 3e38])
def test_a_sensor_of_endless_range_takes_no_memory(reach):
    ranges = np.full(50, np.inf)
    ranges[:5] = 1e38
    scan = Scan.checked(
        ranges, angle_min_rad=0.0, angle_increment_rad=0.1, range_min_m=0.0, range_max_m=reach
    )
    found = no_return_of('auto', [PlacedScan.at(scan, Pose2D())] * 3, 0.001).found
    assert found.crossing == 0


def test_no_more_is_kept_of_a_long_recording():
    watch = NoReturnWatch(0.1)
    for k in range(10 * KEPT):
        watch.see(scan_at(0.001 * k, []))
    assert KEPT <= len(watch._kept) < 2 * KEPT
    assert watch._kept[0].pose.x_m == 0.0
    assert watch._kept[-1].pose.x_m > 0.0009 * 10 * KEPT
