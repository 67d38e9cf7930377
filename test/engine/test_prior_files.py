"""Prior files: what is written is read; one line for what cannot be used; the shipped one."""

import dataclasses
import logging

import numpy as np
import pytest
from support.refusals import refusal_of

from ogm_mcmc.config import LearningConfig, flatten
from ogm_mcmc.engine.prior_files import (
    FIELDS,
    Prior,
    default_prior_file,
    load_prior,
    save_prior,
)
from ogm_mcmc.errors import OutputError, PriorError
from ogm_mcmc.io.training_maps import MapSource
from ogm_mcmc.sampling.patch_learning import count_map
from ogm_mcmc.sampling.patch_prior import make_table


@pytest.fixture(scope='module')
def prior():
    states = np.random.default_rng(3).integers(-1, 2, (30, 25)).astype(np.int8)
    config = LearningConfig()
    return Prior(
        count_map(states, config).without_rare(2),
        flatten(config),
        (MapSource('a.png', 0.05, 'somebody/maps', 'abc', 'MIT'), MapSource('b.png', 0.02)),
    )


@pytest.fixture
def saved(prior, tmp_path):
    return save_prior(prior, tmp_path / 'prior.npz')


@pytest.fixture
def changed(saved):
    """Rewrite the file with fields replaced (None: left out)."""

    def change(**changes):
        with np.load(saved) as data:
            fields = {name: data[name] for name in data.files} | changes
        np.savez(saved, **{name: value for name, value in fields.items() if value is not None})
        return saved

    return change


def message_of(path):
    message = refusal_of(PriorError, load_prior, path)
    assert message.startswith(str(path))
    return message


def test_round_trip(prior, saved):
    loaded = load_prior(saved)
    assert loaded.sources == prior.sources
    assert loaded.options == prior.options
    for name in ('resolution_m', 'dropped'):
        assert getattr(loaded.counts, name) == getattr(prior.counts, name)
    here, there = (dataclasses.astuple(each.counts) for each in (prior, loaded))
    for a, b in zip(here[1:3] + here[3], there[1:3] + there[3], strict=True):
        assert a.dtype == b.dtype
        assert np.array_equal(a, b)
    for kind, size in (('border', 9), ('patch', 25)):
        one, two = (make_table(kind, size, each.counts) for each in (prior, loaded))
        assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def test_the_same_prior_is_the_same_file(prior, saved, tmp_path):
    assert save_prior(prior, tmp_path / 'again.npz').read_bytes() == saved.read_bytes()


def test_a_place_that_cannot_be_written_to(prior, tmp_path):
    with pytest.raises(OutputError):
        save_prior(prior, tmp_path / 'nowhere' / 'prior.npz')


@pytest.mark.parametrize('name', FIELDS)
def test_a_missing_field(changed, name):
    assert f'no field {name}: expected' in message_of(changed(**{name: None}))


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'version': np.int64(2)}, 'version is 2: expected 1'),
        ({'version': np.int64(2), 'cells': None}, 'version is 2: expected 1'),
        ({'patch_size': np.int64(25)}, 'patch_size is 25: expected 9'),
        ({'resolution': np.float64(np.nan)}, 'resolution is nan'),
        ({'resolution': np.array(['fine'])}, 'resolution is <U4 (1,)'),
        ({'patches': np.zeros(511, np.int64)}, 'patches is int64 (511,)'),
        ({'patches': np.zeros(512)}, 'patches is float64 (512,)'),
        ({'patches': np.zeros(512, np.int64)}, 'expected counts'),
        ({'patches': np.full(512, -1)}, 'expected counts'),
        ({'patterns': np.array([3, 2, 1])}, 'expected counts'),
        ({'patterns': np.array([2**25]), 'windows': np.array([1])}, 'expected counts'),
        # A corner of the square that is not the first: not the name of its class.
        ({'patterns': np.array([1 << 4]), 'windows': np.array([1])}, 'expected counts'),
        ({'patterns': np.array([], int), 'windows': np.array([], int)}, 'expected counts'),
        ({'options': np.array('a: [')}, 'options, sources: expected YAML'),
        ({'sources': np.array('- file: a\n  colour: red\n')}, 'options, sources: expected YAML'),
        ({'sources': np.array('7')}, 'options, sources: expected YAML'),
    ],
)
def test_a_wrong_field(changed, changes, reason):
    assert reason in message_of(changed(**changes))


def test_what_is_no_prior_file(tmp_path, saved):
    whole = saved.read_bytes()
    for length in (0, 10, len(whole) // 2, len(whole) - 1):
        saved.write_bytes(whole[:length])
        assert 'expected a complete prior file' in message_of(saved)
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 0xFF
    saved.write_bytes(damaged)
    assert 'expected a complete prior file' in message_of(saved)
    np.save(tmp_path / 'array.npy', np.arange(3))
    assert 'not a zip file' in message_of(tmp_path / 'array.npy')
    np.savez(saved, version=np.array([{'not': 'a number'}], dtype=object))
    assert 'expected a complete prior file' in message_of(saved)
    np.savez(saved, probability=np.zeros((3, 3)))
    assert 'no field version' in message_of(saved)
    assert 'No such file' in message_of(tmp_path / 'nowhere.npz')
    assert 'expected a complete prior file' in message_of(tmp_path)


def test_another_resolution_is_a_warning_that_names_both(saved, caplog):
    with caplog.at_level(logging.WARNING):
        load_prior(saved, 0.05)
        assert caplog.messages == []
        load_prior(saved, 0.02)
    (message,) = caplog.messages
    assert str(saved) in message
    assert 'learned at 0.05 m' in message
    assert 'used at 0.02 m' in message


def test_the_shipped_prior(repository):
    path = default_prior_file()
    assert path == repository / 'config' / 'priors' / 'buildings.npz'
    assert path.stat().st_size < 400_000
    prior = load_prior(path, 0.05)
    assert len(prior.sources) == 12
    described = (path.parent / 'README.md').read_text(encoding='utf-8')
    for source in prior.sources:
        assert source.licence
        assert source.file in described
        assert source.source in described
        assert source.licence in described
    table = make_table('border', 9, prior.counts)
    assert np.diff(table.start).max() < 50
    assert np.diff(table.start)[table.entry_of_border[[0, 0xFFFF]]].tolist() == [1, 1]


def test_no_shipped_prior(monkeypatch, tmp_path):
    from ogm_mcmc.engine import prior_files

    monkeypatch.setattr(prior_files, '__file__', str(tmp_path / 'ogm_mcmc' / 'engine' / 'x.py'))
    with pytest.raises(PriorError, match=r'buildings\.npz: not found'):
        default_prior_file()
    installed = tmp_path / 'lib' / 'python3' / 'site-packages' / 'ogm_mcmc' / 'engine' / 'x.py'
    monkeypatch.setattr(prior_files, '__file__', str(installed))
    share = tmp_path / 'share' / 'ogm_mcmc' / 'priors'
    share.mkdir(parents=True)
    (share / 'buildings.npz').touch()
    assert default_prior_file() == share / 'buildings.npz'
