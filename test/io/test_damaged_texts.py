"""Text files with words and lines changed at random, and files that are none: one line each."""

import os
import time
from collections import Counter

import numpy as np
import pytest
from support.fuzz import ROUNDS, SEED

from ogm_mcmc.cli.evaluate_path import read_way
from ogm_mcmc.errors import BagError, OgmError
from ogm_mcmc.files.output_files import replacing_set
from ogm_mcmc.io.bag_files import kind_of, unpacked
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.io.parameter_files import read_parameter_file
from ogm_mcmc.io.point_files import read_points
from ogm_mcmc.io.relation_files import read_relations
from ogm_mcmc.io.stata_import import read_pose_file
from ogm_mcmc.io.training_maps import read_sources
from ogm_mcmc.io.trajectory_files import read_trajectory
from ogm_mcmc.io.tum_files import read_deviations

SECONDS = np.arange(1, 7) * 1_000_000_000
RAYS = ' '.join(['1.5'] * 180)
LASER = f'FLASER 180 {RAYS} 0.1 0.2 0.3 0.1 0.2 0.3 {{0}}.5 robot {{0}}.5'


def lines(pattern, count=6):
    return '\n'.join(pattern.format(k) for k in range(1, count + 1)) + '\n'


def with_stamps(path):
    stamps = path.with_name('stamps')
    stamps.write_text(lines('{0} {0}.5'))
    return read_trajectory(path, stamps)


def deviations(path):
    beside = path.with_name('trajectory_deviations.csv')
    path.rename(beside)
    return read_deviations(path.with_name('trajectory.txt'), SECONDS + 250_000_000)


READERS = {
    'tum': (lines('{0}.25 0.1 0.2 0 0 0 0 1'), read_trajectory),
    'euroc': (lines('{0}000000000, 0.1, 0.2, 0, 1, 0, 0, 0'), read_trajectory),
    'g2o': (lines('VERTEX_SE2 {0} 0.1 0.2 0.3'), with_stamps),
    'deviations': ('stamp_s,x_m,y_m,yaw_rad\n' + lines('{0}.25,0.1,0.1,0.1'), deviations),
    'points': ('x,y\n' + lines('{0},0.5'), read_points),
    'way': (lines('{0},0.5,0.1'), read_way),
    'relations': (
        lines('{0}.0 {0}.5 0.1 0.2 0 0 0 0.1'),
        read_relations,
    ),
    'sources': (
        'file,resolution_m,repository,commit,licence\n' + lines('a{0}.png,0.05,a/b,c,MIT'),
        read_sources,
    ),
    'stata': (lines('{0}000000, 0.1, 0.2, 0.3'), read_pose_file),
    'carmen': (lines(LASER), read_carmen),
    'parameters': (
        '/**:\n  ros__parameters:\n    resolution: 0.05\n    step: {l_occ: 1.4}\n',
        read_parameter_file,
    ),
}

WORDS = [
    *('nan', '-inf', '1e999', '-1e308', '5e-324', '1e-400', '9' * 400, '0x10', '1_0', '\u0661'),
    *('', '-', '#', ',', '"', "'", '\0', '\ufeff', '\u2028', '\t', '--1', 'None', 'true'),
    *('<<: *a', '&a', '!!python/object:a', '[[[[', '18446744073709551616', '-9223372036854775809'),
    *('!!int ""', '!!bool x', '!!timestamp x', '!!str'),
]


def changed(text, rng):
    """Exchange, drop or double words and lines."""
    said = text.split('\n')
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(said)))
        kind = rng.integers(6)
        if kind < 3:
            words = said[at].replace(',', ' , ').split(' ')
            words[rng.integers(len(words))] = WORDS[rng.integers(len(WORDS))]
            said[at] = ' '.join(words).replace(' , ', ',')
        elif kind == 3:
            said[at : at + 1] = []
        elif kind == 4:
            said.insert(int(rng.integers(len(said) + 1)), said[at])
        else:
            said[at] = said[at][: rng.integers(len(said[at]) + 1)]
        if not said:
            return ''
    return ['\n', '\r\n', '\r', '\n\n'][rng.integers(4) if rng.random() < 0.2 else 0].join(said)


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', READERS)
def test_texts(tmp_path, name):
    text, read = READERS[name]
    path = tmp_path / 'text'
    rng = np.random.default_rng(SEED)
    outcomes = Counter()
    for number in range(ROUNDS + 1):
        path.write_text(changed(text, rng) if number else text, encoding='utf-8', newline='')
        try:
            read(path)
        except OgmError as error:
            one = str(error).splitlines() == [str(error)] and len(str(error)) < 1000
            outcomes['refused' if one else f'refused: {error}'] += 1
        else:
            outcomes['read'] += 1
        if number == 0:
            assert outcomes == {'read': 1}
    # Of a log a damaged line is left out, and counted.
    assert name == 'carmen' or outcomes['refused'] > ROUNDS // 20
    assert set(outcomes) <= {'read', 'refused'}


@pytest.mark.parametrize('read', [kind_of, *(one for _, one in READERS.values())])
def test_a_pipe_in_place_of_a_file_is_refused_at_once(tmp_path, read):
    os.mkfifo(tmp_path / 'text')
    started = time.monotonic()
    with pytest.raises(OgmError, match='regular file'):
        read(tmp_path / 'text')
    assert time.monotonic() - started < 5.0


def test_a_pipe_among_the_files_of_a_bag_or_of_a_map(tmp_path):
    (tmp_path / 'bag').mkdir()
    os.mkfifo(tmp_path / 'bag' / 'metadata.yaml')
    with pytest.raises(BagError, match=r'no metadata\.yaml in it'):
        BagReader(tmp_path / 'bag').__enter__()
    os.mkfifo(tmp_path / 'map.yaml')
    with replacing_set(tmp_path, 'map') as scratch:
        (scratch / 'map.yaml').write_text('image: map.pgm\n')
        (scratch / 'map.pgm').write_text('')
    assert (tmp_path / 'map.yaml').read_text() == 'image: map.pgm\n'


@pytest.mark.parametrize('image', ['!!int ""', '!!bool x', '!!timestamp x'])
def test_a_map_whose_image_is_no_name_is_replaced(tmp_path, image):
    (tmp_path / 'map.yaml').write_text(f'image: {image}\n')
    with replacing_set(tmp_path, 'map') as scratch:
        (scratch / 'map.yaml').write_text('image: map.pgm\n')
        (scratch / 'map.pgm').write_text('')
    assert (tmp_path / 'map.yaml').read_text() == 'image: map.pgm\n'


def test_a_message_that_unfolds_is_refused_before_it_fills_the_memory(monkeypatch):
    zstd = pytest.importorskip('backports.zstd')
    packed = zstd.compress(b'\0' * 300_000)
    assert unpacked(packed) == b'\0' * 300_000
    monkeypatch.setattr('ogm_mcmc.io.bag_files.LARGEST_MESSAGE', 200_000)
    for damaged in (packed, zstd.compress(b'abcdefgh')[:-3]):
        with pytest.raises(BagError, match='cut off, or more than 200000 bytes'):
            unpacked(damaged)
