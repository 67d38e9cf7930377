"""Tables III and IV of [patch]: every value of ours stands beside the one it is compared with.

Maps are made up: a value tells resolution, experiment, method and sensor model of its map.
"""

import json
from dataclasses import replace

import pytest

from ogm_mcmc.lab.experiments import patch_hardware
from ogm_mcmc.lab.experiments.patch_hardware_page import METHODS, part_name
from ogm_mcmc.lab.experiments.results import picture_text

# As printed: portions of cells mapped, per cent; seconds without and with border.
TABLE_III = {
    'intel': {'benchmark': 59.63, 1: 55.78, 2: 50.27, 3: 28.22},
    'stata': {'benchmark': 16.21, 4: 14.58, 5: 11.74, 6: 5.23},
}
NEAR = {'intel': 73.04, 'stata': 24.09}
TABLE_IV = {
    1: (6433.0, 1518.0), 2: (3023.0, 723.6), 3: (306.1, 166.8),
    4: (4158.0, 1734.0), 5: (557.2, 201.2), 6: (44.71, 33.14),
}  # fmt: skip
PRINTED_CM = {'intel': '2', 'stata': '3.3'}

calls: list[str] = []


def told(resolution, number, method, kind):
    """Return a value that no other map has, below 1."""
    return number / 10 + METHODS.index(method) / 100 + resolution / 100 + (kind == 'beam') / 1e5


def fake_score(of, data, resolution, number, method, kind, sweeps, seed, held_out_scans):
    calls.append(part_name(kind, resolution, number, method))
    value = told(resolution, number, method, kind)
    return {
        'picture': picture_text(b'png'),
        'benchmark_mapped_share': 0.9 + resolution,
        'benchmark_poses': 900,
        'benchmark_beams': 90_000,
        'near_share': 0.8 + resolution,
        'mapped_share': 0.7 + value / 10,
        'poses': 90 * number,
        'beams': 900 * number,
        'max_f1': value,
        'threshold': 0.25,
        'precision': 0.5,
        'recall': 0.75,
        'f1_at_half': 0.125,
        'heldout_loglik_per_beam': -value,
        'heldout_standard_error': 0.0625,
        'seconds_per_sample': None if method == 'traditional' else 1000 * value,
        'window_corner_m': [-1.0, -2.0],
        'f1_curve': [value] * 101,
        'settings': {}
        if method == 'traditional'
        else {'chain.burn_in': sweeps[0], 'sweeps': sweeps[1], 'model.sigma': 0.05},
    }


def fake_unseen(data, resolution, number, start, sweeps, seed):
    assert (resolution, number) == (0.05, 3)
    return {
        'picture': picture_text(b'png'),
        'unknown_of_never_measured': {'live': 0.1, 'dispersed': 0.9}[start],
        'unknown_of_measured': 0.05,
        'occupied_of_never_measured': 0.7,
    }


@pytest.fixture(params=['intel', 'stata'])
def of(request, tmp_path, monkeypatch):
    """A recording without any scans, and no drawing of its benchmark."""
    monkeypatch.setenv('OGM_MCMC_WORKERS', '1')
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path / 'data'))
    monkeypatch.setattr(patch_hardware, 'score', fake_score)
    monkeypatch.setattr(patch_hardware, 'unseen', fake_unseen)
    monkeypatch.setattr(patch_hardware, 'benchmark_with_rays', lambda *_: b'png')
    empty = replace(patch_hardware.SETS[request.param], read=lambda path: [])
    monkeypatch.setattr(patch_hardware, request.param.upper(), empty)
    (tmp_path / 'data' / empty.path).mkdir(parents=True)
    (tmp_path / 'out').mkdir()
    return empty


def run(of, tmp_path, quick=False):
    of_name = {'intel': patch_hardware.run_intel, 'stata': patch_hardware.run_stata}
    result = of_name[of.name](tmp_path / 'out', quick=quick, seed=1)
    rows = {line['what']: (line['ours'], line['published']) for line in result['rows']}
    assert len(rows) == len(result['rows'])
    json.dumps(result)
    assert all((tmp_path / 'out' / name).is_file() for name in result['pictures'])
    return result, rows


def test_portions_of_cells_mapped_are_those_of_table_iii(of, tmp_path):
    _, rows = run(of, tmp_path)
    for resolution in of.resolutions_m:
        cells = f'{100 * resolution:.2g}'
        printed = {what: share / 100 for what, share in TABLE_III[of.name].items()}
        near = NEAR[of.name] / 100
        if cells != PRINTED_CM[of.name]:
            printed, near = dict.fromkeys(printed), None
        expected = {
            'benchmark': 0.9 + resolution,
            **{
                number: 0.7 + told(resolution, number, 'traditional', 'beam') / 10
                for number in of.pose_strides
            },
        }
        for what, ours in expected.items():
            name = what if what == 'benchmark' else f'experiment {what}'
            found = rows[f'{cells} cm, {name}: portion of cells mapped']
            assert found == (ours, pytest.approx(printed[what]))
        found = rows[f'{cells} cm: portion of cells that count']
        assert found == (0.8 + resolution, pytest.approx(near))


def test_seconds_of_a_sample_are_those_of_table_iv(of, tmp_path):
    result, rows = run(of, tmp_path)
    published = 0
    maps = [
        ('', 'beam', resolution, method) for resolution in of.resolutions_m for method in METHODS
    ]
    maps += [('gaussian, ', 'gaussian', of.resolutions_m[0], m) for m in ('cell', 'border9')]
    for prefix, kind, resolution, method in maps:
        cells = f'{100 * resolution:.2g}'
        for number in of.pose_strides:
            what = f'{prefix}{cells} cm, experiment {number}, {method}'
            value = told(resolution, number, method, kind)
            assert rows[f'{what}: max F1'] == (value, None)
            assert rows[f'{what}: nats per held-out beam'] == (-value, None)
            if method == 'traditional':
                assert f'{what}: s per map sample' not in rows
                continue
            printed = dict(zip(('patch9', 'border9'), TABLE_IV[number], strict=True)).get(method)
            if cells != PRINTED_CM[of.name]:
                printed = None
            published += printed is not None
            assert rows[f'{what}: s per map sample'] == (1000 * value, printed)
    # Intel samples with the Gaussian in cells of 5 cm only.
    assert published == {'intel': 6, 'stata': 9}[of.name]
    for resolution in of.resolutions_m:
        found = result['results'][f'{100 * resolution:.2g}cm']
        for number in of.pose_strides:
            for method in METHODS:
                one = found[f'experiment_{number}'][method]
                assert one['max_f1'] == told(resolution, number, method, 'beam')


def test_quick_takes_its_cells_alone_and_again_nothing(of, tmp_path):
    calls.clear()
    result, rows = run(of, tmp_path, quick=True)
    cells = f'{100 * of.quick_resolution_m:.2g}'
    assert sorted(calls) == sorted(
        f'beam_{cells}cm_exp{number}_{method}' for number in of.pose_strides for method in METHODS
    )
    assert list(result['results']) == [f'{cells}cm']
    if of.name == 'intel':
        assert rows['unseen_live: never measured cells left unknown'] == (0.1, None)
        assert rows['unseen_dispersed: never measured cells left unknown'] == (0.9, None)
    calls.clear()
    assert run(of, tmp_path, quick=True)[1] == rows
    assert calls == []
