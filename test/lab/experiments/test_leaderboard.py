"""The leaderboard: which beams map and judge, one small contest, and the page."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ogm_mcmc import __version__
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, Scan
from ogm_mcmc.lab.experiments import contests, leaderboard, leaderboard_gains, mappers
from ogm_mcmc.lab.experiments.leaderboard_page import leaderboard_page

SPEC = GridSpec(0.1, 40, 40, -20, -20)


def room_scan(stamp_ns: int = 0) -> Scan:
    """A scan of 80 beams in the middle of a square room of 3 m."""
    bearings = np.linspace(-math.pi, math.pi, 80, endpoint=False)
    ranges = 1.55 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    return Scan.checked(
        ranges, angle_min_rad=-math.pi, angle_increment_rad=math.pi / 40.0,
        range_min_m=0.0, range_max_m=5.0, stamp_ns=stamp_ns,
    )  # fmt: skip


def room() -> contests.Contest:
    occupied = np.zeros((40, 40), np.float32)
    occupied[4:36, (4, 35)] = occupied[(4, 35), 4:36] = 1.0
    placed = [PlacedScan.at(room_scan(k), Pose2D()) for k in range(3)]
    return contests.Contest(
        placed, placed, GridMap(SPEC, occupied), 0.1, 'clear', ('two_assumption', 'counting')
    )


def test_even_beams_map_and_odd_ones_judge() -> None:
    contest = room()
    for every in leaderboard.PERCENTS.values():
        mapped = leaderboard.thinned(contest.believed[0], every).scan.ranges_m
        assert np.array_equal(np.flatnonzero(np.isfinite(mapped)), np.arange(0, 80, 2 * every))
    judging = leaderboard.judging_scans(contest)[0].scan.ranges_m
    assert np.array_equal(np.flatnonzero(np.isfinite(judging)), np.arange(1, 80, 2))
    assert np.isfinite(contest.believed[0].scan.ranges_m).all()


def test_a_room_is_judged_by_beams_and_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leaderboard, 'building_contest', lambda name, seed: room())
    found = leaderboard.score('building-1', 100, 'fixed', 1)
    assert list(found['mappers']) == ['two_assumption', 'counting']
    base = found['mappers']['two_assumption']
    assert base['difference'] == 0.0
    other = found['mappers']['counting']
    assert other['difference'] == pytest.approx(other['nats'] - base['nats'])
    # Even beams meet fewer cells of the walls than all beams do, and nothing else.
    assert 0.5 < base['best_f1'] < 0.6
    assert base['points_roc_area'] > 0.8
    assert base['seconds'] >= 0.0
    assert base['chains'] == 0
    assert leaderboard.score('building-1', 100, 'fixed', 1, scans=2)['scans'] == 2


def test_a_sampled_map_tells_of_how_many_chains_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The default for single cells."""
    monkeypatch.setattr(mappers, 'warm_up_sampling', lambda config: None)  # no clock counts here
    made = mappers.MAPPERS['sampled, single cells'](room().believed, room(), 1)
    assert made.chains == 2
    assert np.isfinite(made.grid_map.probability).any()


def test_resources_tell_how_much_memory_was_taken() -> None:
    """Also where malloc holds as much that is free: between others, on its heap."""
    np.ones(31_000_000 // 8)  # once freed, smaller pieces come from the heap
    pieces = [np.ones(24_000_000 // 8) for _ in range(3)]
    behind = np.ones(16_000_000 // 8)
    del pieces
    watch = mappers.Resources()
    taken = np.ones(60_000_000 // 8)
    used = watch.stop()
    assert taken.sum() + behind.sum() > 0.0
    if used.megabytes is None:
        pytest.skip('no /proc: only Linux tells the highest memory')
    assert 50.0 < used.megabytes < 90.0


def entry(data: str, percent: int, poses: str, **nats: float) -> dict[str, object]:
    figures = {
        'points_roc_area': 0.9, 'seconds': 1.25, 'megabytes': None, 'best_f1': 0.5, 'f1': 0.25,
        'roc_area': 0.75, 'brier': 0.125, 'calibration_error': 0.0625,
    }  # fmt: skip
    found = {name: {'nats': value, **figures} for name, value in nats.items()}
    return {'data': data, 'percent': percent, 'poses': poses, 'mappers': found}


def test_the_page_has_a_line_for_each_mapper_and_marks_the_best() -> None:
    page = leaderboard_page(
        {
            'version': '1',
            'seed': 3,
            'every': {
                'names': ['intel', 'csail', 'building-1', 'building-2'],
                'percents': [100, 25, 5],
            },
            'entries': [
                entry('intel', 100, 'fixed', a=0.5, b=1.0),
                entry('intel', 5, 'fixed', a=-0.25, b=-1.0),
                entry('intel', 100, 'joint', b=2.0),
                entry('building-1', 5, 'fixed', a=1.0, b=3.0),
                entry('building-2', 5, 'fixed', a=2.0, b=3.0),
            ],
        }
    )
    lines = page.splitlines()
    assert '| mapper | 100 % | 5 % | points | s | MB |' in lines
    assert '| a | 0.500 | **-0.250** | **0.900** | 1.2 | - |' in lines
    assert '| b, joint poses | **2.000** | - | **0.900** | 1.2 | - |' in lines
    assert any(line.startswith('| a | 1.500 | **0.500** |') for line in lines)  # the mean of two
    assert any(line.startswith('| b | **3.000** |') for line in lines)
    assert 'Means of 2 generated buildings' in page
    missing = 'no csail, no 25 % of the beams, no building-1 with 100 %, no building-2 with 100 %'
    assert lines[-1] == f'- In this result: {missing}.'
    assert '- With joint poses only `two_assumption` and `sampled, border prior` are run.' in lines


def test_lines_of_two_chains_in_all_columns_are_marked() -> None:
    def of_chains(percent: int, poses: str, **chains: int) -> dict[str, object]:
        found: Any = entry('intel', percent, poses, **dict.fromkeys(chains, 0.5))
        for name, count in chains.items():
            found['mappers'][name]['chains'] = count
        return found

    entries = [
        of_chains(100, 'fixed', live=0, cells=2, border=2),
        of_chains(5, 'fixed', live=0, cells=2, border=8),
        of_chains(100, 'joint', border=2),
    ]
    every = {'names': ['intel'], 'percents': [100, 5]}
    page = leaderboard_page({'version': '1', 'seed': 3, 'every': every, 'entries': entries})
    names = [line.split(' | ')[0][2:] for line in page.splitlines() if line.startswith('| ')]
    assert names[2:] == ['live', 'cells, 2 chains', 'border', 'border, joint poses, 2 chains']


def test_the_page_of_a_quick_run_says_of_how_many_scans_it_is() -> None:
    every = {'names': ['building-1'], 'percents': [25], 'scans': 60}
    entries = [entry('building-1', 25, 'fixed', a=1.0)]
    page = leaderboard_page({'version': '1', 'seed': 3, 'every': every, 'entries': entries})
    assert page.endswith('\n- In this result: no scans but the first 60.\n')


def test_the_page_in_the_docs_is_what_the_experiment_writes() -> None:
    """But for the figures, and for what was left out: every line that is no row of a table."""
    page = (Path(__file__).parents[3] / 'docs' / 'leaderboard.md').read_text()
    names = [*contests.LOGS, *(f'building-{k}' for k in range(1, leaderboard.BUILDINGS + 1))]
    percents = list(leaderboard.PERCENTS)
    made = leaderboard_page(
        {
            'version': __version__,
            'seed': 1,
            'every': {'names': names, 'percents': percents},
            'entries': [
                entry(name, p, 'fixed', **{leaderboard_gains.BORDER: 0.5})
                for p in percents
                for name in names
            ],
        }
    )

    def told(text: str) -> list[str]:
        return [line for line in text.splitlines() if not line.startswith(('|', '- In this'))]

    assert told(page) == told(made)
    for mapper in mappers.MAPPERS:
        assert re.search(rf'\n\| {mapper}(, 2 chains)? \|', page)
    for mapper in mappers.WITH_JOINT_POSES:
        assert re.search(rf'\n\| {mapper}, joint poses(, 2 chains)? \|', page)


def test_what_the_border_prior_is_worth_is_paired() -> None:
    border, patch = leaderboard_gains.BORDER, 'sampled, patch prior'
    assert {border, *leaderboard_gains.OF_LOGS, *leaderboard_gains.OF_BUILDINGS} <= set(
        mappers.MAPPERS
    )
    log: Any = entry('intel', 25, 'fixed', **{border: 1.0, patch: 0.25, 'counting': 1.5})
    log['mappers'][patch]['border_gain_error'] = 0.0625
    of_buildings = [
        entry(f'building-{k}', percent, 'fixed', **{border: 1.0 + k, patch: nats})
        for percent in (100, 5)
        for k, nats in enumerate((1.0, 2.5))
    ]
    joint = entry('building-1', 5, 'joint', **{border: 2.25})
    logs, buildings = leaderboard_gains.gains([log, *of_buildings, joint])
    assert '| nats a beam | 25 % |\n' in logs
    assert '| intel: sampled, patch prior | +0.750 +- 0.062 |\n' in logs
    assert '| intel: counting | -0.500 |\n' in logs  # as of results that kept no error
    assert '| building by building | 100 % | 5 % |\n' in buildings
    paired = '-0.250 +- 0.250'
    assert f'| sampled, patch prior: nats | {paired} | {paired} |\n' in buildings
    assert '| joint poses: nats | - | +0.250 |\n' in buildings
    assert leaderboard_gains.gains([entry('intel', 25, 'fixed', a=1.0)]) == []


def test_what_is_written_of_the_leaderboard_holds_in_its_tables() -> None:
    """When this fails after a run: see README and the section of `docs/results.md`."""
    root = Path(__file__).parents[3]
    page = (root / 'docs' / 'leaderboard.md').read_text()
    tables = {}
    for part in re.split(r'\n(?=##+ )', page)[1:]:
        heading, *lines = part.splitlines()
        cells = [line.strip('| ').replace('*', '').split(' | ') for line in lines if '|' in line]
        if cells:
            rows = {name.removesuffix(', 2 chains'): of for name, *of in cells[2:]}
            tables[heading.lstrip('# ')] = cells[0][1:], rows

    def first(table: str, column: str, highest: bool = True) -> str:
        header, rows = tables[table]
        of = {
            name: float(row[header.index(column)])
            for name, row in rows.items()
            if not name.endswith('joint poses')
        }
        return (max if highest else min)(of, key=lambda name: of[name])

    border, sampled = (
        leaderboard_gains.BORDER,
        [name for name in mappers.MAPPERS if 'sampl' in name],
    )
    for log in contests.LOGS:
        assert {first(log, f'{percent} %') for percent in leaderboard.PERCENTS} == {border}, log
        header, rows = tables[log]
        points = header.index('points')
        best = sorted(mappers.FOR_EXACT_POSES, key=lambda name: float(rows[name][points]))[-3:]
        assert sorted(best) == sorted(sampled), log
    for percent in leaderboard.PERCENTS:
        of = f'{percent} % of the beams'
        assert {first(of, column) for column in ('nats', 'best F1')} == {border}
        errors = ('Brier', 'calibration error')
        assert {first(of, column, highest=False) for column in errors} == {border}

    intel = tables['intel'][1]

    def quoted(name: str) -> list[str]:
        return [f'{float(figure):.2f}' for figure in intel[name][:3]]

    readme = ' '.join((root / 'README.md').read_text().split())
    ours, others = quoted(border), quoted('counting')
    assert f'Intel {ours[0]}, {ours[1]} and {ours[2]} nats a beam' in readme
    assert f'with all beams: {others[0]}, {others[1]} and {others[2]})' in readme
    assert f'Intel has {quoted(f"{border}, joint poses")[0]} nats' in readme


def test_a_log_of_particles_is_placed_where_the_best_came_to(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The pose in the line, 700 m away, is odometry; the second particle weighs more."""
    ranges = ' '.join(['1.0'] * 180)
    lines = []
    for k in range(2):
        lines.append(f'LASER_READING 180 {ranges} {700 + k} 0 0 {k + 1}.0')
        lines.append(f'SM_UPDATE 2 {k} 5 0 -9 {k + 10} 5 0 -1')
    (tmp_path / 'some.gfs').write_text('\n'.join(lines) + '\n')
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path))
    monkeypatch.setitem(contests.LOGS, 'some', contests.RecordedLog('some.gfs', 'nobody'))
    contest = contests.log_contest('some')
    assert [one.pose for one in contest.believed] == [Pose2D(10.0, 5.0), Pose2D(11.0, 5.0)]
    assert contest.judging is contest.believed


def test_a_missing_log_is_said_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path))
    with pytest.raises(ConfigError, match=r'intel\.gfs\.log'):
        contests.LOGS['intel'].path()
