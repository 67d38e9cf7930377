"""Chains in files: taken up as if nothing had happened; whatever else is there is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.refusals import refusal_of
from support.small_chains import assert_same, patch_model, sampler_of, small_model
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.engine.saved_chains import (
    VERSION,
    load_chains,
    require_saved,
    save_chains,
    saved_settings,
)
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling import CellModel, RayWindow, burn_in
from ogm_mcmc.sampling.gibbs_kernels import PARTS
from ogm_mcmc.sampling.informed import near
from ogm_mcmc.sampling.posterior import ARRIVES, SETTLED


@pytest.mark.parametrize('sweeps', [0, 3, 30, 200])
def test_saved_chains_go_on_as_if_nothing_had_happened(tmp_path, sweeps):
    model = small_model('random')
    whole, first = sampler_of(model, chains=3), sampler_of(model, chains=3)
    whole.advance(sweeps + 50)
    first.advance(sweeps)
    settings = {'chain.seed': 7, 'model.kind': 'beam'}
    save_chains(first, tmp_path / 'state.npz', settings)
    taken_up, found = load_chains(tmp_path / 'state.npz', small_model('random'))
    assert found == settings
    assert_same(taken_up, first)
    taken_up.advance(50)
    assert_same(taken_up, whole)


@pytest.mark.parametrize(
    ('burn_in', 'saved_at', 'after'),
    [
        (2, 41, 0),
        (20, 8, 0),
        (20, 17, 16),
        (20, 19, 18),
        (20, 25, 18),
        (40, 9, 8),  # the likelihood has a power then, see `burn_in.power_after`
        (40, 33, 32),
        (40, 80, 38),
    ],
)
def test_where_sweeps_look_most_is_the_same_after_saving(tmp_path, burn_in, saved_at, after):
    """At any sweep, though it does not follow from what is counted later."""
    whole, first = (sampler_of(patch_model(), burn_in=burn_in) for _ in range(2))
    whole.advance(burn_in + 98)
    first.advance(saved_at)
    save_chains(first, tmp_path / 'state.npz', {})
    taken_up, _ = load_chains(tmp_path / 'state.npz', patch_model())
    assert [focus.after for focus in taken_up.focus.values()] == ([after] * 2 if after else [])
    taken_up.advance(burn_in + 98 - saved_at)
    assert_same(taken_up, whole)


@pytest.mark.parametrize('saved_at', [100, 198, 199, 230, 260])
def test_a_burn_in_ends_alike_after_saving(tmp_path, saved_at, monkeypatch):
    monkeypatch.setattr(burn_in, 'AGREEING', (1.2, 0.9))
    whole, first = (sampler_of(patch_model(), burn_in=400, may_end=True) for _ in range(2))
    whole.advance(300)
    assert whole.counted > 0
    first.advance(saved_at)
    save_chains(first, tmp_path / 'state.npz', {})
    taken_up, _ = load_chains(tmp_path / 'state.npz', patch_model())
    taken_up.advance(300 - saved_at)
    assert_same(taken_up, whole)


def test_sweeps_look_most_at_patches_with_cells_in_doubt():
    """Those that moved in all but the first quarter of the burn-in, where a ray arrives."""
    sampler = sampler_of(patch_model(), burn_in=50)
    sampler.advance(48)
    told = [
        (counts.counts[3:12].sum(axis=0) / (36.0 * PARTS)).astype(np.float32)
        for counts in sampler.settling
    ]
    sampler.advance(20)
    model, n_in_doubt = sampler.model, 0
    for chain, mean in enumerate(told):
        after, cells, places = sampler.focus[chain]
        assert after == 48
        moving = np.zeros(model.n_cells, np.bool_)
        moving[model.touched] = (mean > SETTLED) & (mean < 1.0 - SETTLED)
        expected = np.flatnonzero(moving & (sampler.arrival(mean) >= ARRIVES))
        assert np.array_equal(model.touched[cells[0]], expected)
        some = [np.isin(c + model._inner, expected).any() for c in model._places.corners]
        n_in_doubt += np.count_nonzero(some)
        active = np.concatenate(places.active)
        assert np.array_equal(np.sort(active), model._places.corners[some])
        shape = model.height, model.width
        assert np.array_equal(places.doubted, near(moving.reshape(shape), 1).reshape(-1))
    assert n_in_doubt > 0


@pytest.fixture
def saved(tmp_path):
    sampler = sampler_of(small_model())
    sampler.advance(40)
    save_chains(sampler, tmp_path / 'state.npz', {})
    return tmp_path / 'state.npz'


def refused(path, model=None):
    message = refusal_of(WindowError, load_chains, path, model or small_model())
    assert message.startswith(f'{path}: ')
    assert 'expected' in message
    return message


@pytest.mark.parametrize('share', [0.0, 0.02, 0.3, 0.7, 0.99])
def test_a_truncated_file_is_refused(saved, share):
    content = saved.read_bytes()
    saved.write_bytes(content[: int(share * len(content))])
    assert 'expected a saved sampling state' in refused(saved)


def test_a_damaged_file_is_refused(saved):
    """Whatever byte was changed: a clear line, or (in padding and names) no harm."""
    content = bytearray(saved.read_bytes())
    rng = np.random.default_rng(3)
    reasons = []
    for at in rng.integers(0, len(content), 60):
        damaged = content.copy()
        damaged[at] ^= 0xFF
        saved.write_bytes(damaged)
        try:
            load_chains(saved, small_model())
        except WindowError as error:
            reasons.append(str(error))
    assert len(reasons) > 30
    assert not any('\n' in reason for reason in reasons)


def test_other_files_are_refused(tmp_path):
    assert 'No such file' in refused(tmp_path / 'missing.npz')
    (tmp_path / 'text.npz').write_text('P5 10 10 255\n')
    refused(tmp_path / 'text.npz')
    np.save(tmp_path / 'array.npy', np.zeros(3))
    refused(tmp_path / 'array.npy')
    np.savez(tmp_path / 'other.npz', mean=np.zeros(3))
    refused(tmp_path / 'other.npz')
    np.savez(tmp_path / 'list.npz', header=np.array('[1, 2]'))
    refused(tmp_path / 'list.npz')
    refused(tmp_path)


def rewritten(path, header=None, **arrays):
    with np.load(path) as data:
        content = {name: data[name] for name in data.files}
    if header is not None:
        changed = {**json.loads(str(content['header'])), **header}
        content['header'] = np.array(json.dumps(changed))
    np.savez(path, **{**content, **arrays})


@pytest.mark.parametrize(
    'change',
    [
        {'header': {'version': 1}},
        {'header': {'version': VERSION + 1}},
        {'header': {'focus_after': [3, 3]}},
        {'header': {'focus_after': [16]}},
        {'header': {'chains': 3}},
        {'header': {'generators': []}},
        {'header': {'sweeps': -4}},
        {'header': {'settling': 1}},
        {'header': {'settling': 3}},
        {'header': {'settling': -2}},
        {'counts_0': np.zeros((16, 2), np.uint16)},
        {'counts_1': np.zeros((3, 12), np.uint16)},
        {'counts_0': np.zeros(0)},
        {'progress_0': np.array([1, 99, 0])},
        {'progress_1': np.array([1])},
        {'cells_0': np.zeros(1, np.uint8)},
    ],
)
def test_contents_that_do_not_fit_are_refused(saved, change):
    """They would be written to out of bounds later."""
    rewritten(saved, **change)
    refused(saved)


def test_counts_of_more_sweeps_than_there_were_are_refused(saved):
    with np.load(saved) as data:
        counts = data['counts_0'].copy()
    counts[0, 3] = 65535
    rewritten(saved, counts_0=counts)
    refused(saved)


def test_another_window_is_refused(saved):
    """Of another size, and of the same size with other readings or other cells."""
    window = RayWindow(WindowConfig(resolution=0.5), ForwardModelConfig(sigma=0.6))
    window.add([PlacedScan.at(fan(1.0, range_max_m=3.0), Pose2D(0.3, 0.4))])
    other = CellModel(window.index, 0.0, window.spec.width)
    assert 'those of this window' in refused(saved, other)
    same_size = small_model(reading=1.7)
    assert same_size.touched.size == small_model().touched.size
    assert same_size.n_cells == small_model().n_cells
    assert 'this window' in refused(saved, same_size)


@pytest.mark.parametrize('version', [1, 2, 3, 4])
def test_a_state_of_an_older_version_is_refused_for_that(saved, version):
    """Before its settings are compared, of which some did not exist then."""
    rewritten(saved, header={'version': version, 'settings': {}})
    with pytest.raises(WindowError, match=f'version {version}: expected {VERSION}') as caught:
        saved_settings(saved)
    assert '\n' not in str(caught.value)
    assert refused(saved) == str(caught.value)


@pytest.mark.parametrize(
    ('saved', 'said'),
    [
        ({'patch.prior_file': ''}, "patch.prior_file '', as it was saved with, not 'x'"),
        ({'seed': 1}, 'saved by a version without patch.prior_file: '),
        ({'patch.prior_file': 'x', 'seed': 2}, 'expected seed 2, as it was saved with, not 1'),
    ],
)
def test_the_first_setting_that_differs_is_told_with_both_values(saved, said):
    """An empty text is seen as one; what the file lacks was not saved with it."""
    with pytest.raises(WindowError) as caught:
        require_saved(Path('chains.npz'), {'patch.prior_file': 'x', 'seed': 1}, saved)
    assert said in str(caught.value)
