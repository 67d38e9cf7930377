"""`learn-prior` as a user meets it."""

import json

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.cli.main import run
from ogm_mcmc.engine.prior_files import default_prior_file, load_prior


def save_room(path, width=40, height=30, colours=False):
    """A room with walls of two cells, unknown around."""
    pixels = np.full((height, width), 127, np.uint8)
    pixels[5:-5, 5:-5] = 0
    pixels[7:-7, 7:-7] = 255
    pixels[12, 20] = 0
    if colours:
        pixels = np.dstack([pixels, pixels, 255 - pixels])
    Image.fromarray(pixels).save(path)


@pytest.fixture
def maps(tmp_path):
    """Two rooms with a list of sources beside, one with a YAML of its own."""
    save_room(tmp_path / 'a.png')
    save_room(tmp_path / 'b.pgm', width=50)
    (tmp_path / 'SOURCES.csv').write_text(
        'file,resolution_m,source,commit,licence\na.png,0.05,x/y,abc,MIT\n'
    )
    (tmp_path / 'b.yaml').write_text(
        'image: b.pgm\nresolution: 0.025\norigin: [0, 0, 0]\nnegate: 0\n'
        'occupied_thresh: 0.65\nfree_thresh: 0.196\n'
    )
    return tmp_path


def test_learns_and_reports(run_cli, maps):
    done = run_cli('learn-prior', 'a.png', 'b.yaml', '-o', 'prior.npz', '--held-out', '--json')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    prior = load_prior(maps / 'prior.npz')
    assert [source.file for source in prior.sources] == ['a.png', 'b.yaml']
    assert prior.sources[0].licence == 'MIT'
    assert prior.sources[1].resolution_m == 0.025
    assert prior.options == result['settings']
    assert result['p_occupied'] == pytest.approx(prior.counts.p_occupied)
    # The whole of a.png, 40 x 30, and b.pgm pooled to 25 x 15: all near a known cell.
    assert prior.counts.cells.sum() == 40 * 30 + 25 * 15
    assert result['windows'] == 36 * 26 + 21 * 11
    assert result['bytes'] == (maps / 'prior.npz').stat().st_size
    assert set(result['held_out']) == {'a.png', 'b.yaml'}
    assert all(0.0 < nats < 9 * np.log(2) for nats in result['held_out'].values())


def test_the_report_stands_beside_the_published_figures(run_cli, maps):
    done = run_cli('learn-prior', 'a.png', '-o', 'prior.npz', '--unknown', 'skip', '--least', 2)
    assert done.returncode == 0, done.stderr
    for expected in ('1 maps', '[patch]', 'p(occupied)', '865', '124', 'dropped as too rare'):
        assert expected in done.stdout
    prior = load_prior(maps / 'prior.npz')
    assert prior.options['unknown'] == 'skip'
    assert prior.options['least'] == 2
    assert prior.counts.squares.windows.min() >= 2
    assert prior.counts.cells.tolist() == [26 * 16 - 1, 30 * 20 - 26 * 16 + 1]


@pytest.mark.parametrize(
    ('coarser', 'cells'), [('as_is', 1200), ('stretch', 4800), ('skip', None)]
)
def test_maps_coarser_than_the_prior(run_cli, maps, coarser, cells):
    options = ('--resolution', '0.025', '--coarser', coarser, '--json')
    done = run_cli('learn-prior', 'a.png', 'b.pgm', '-o', 'prior.npz', *options)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    prior = load_prior(maps / 'prior.npz')
    assert prior.counts.resolution_m == 0.025
    assert prior.counts.cells.sum() == 50 * 30 + (cells or 0)
    assert result['skipped'] == ([] if cells else ['a.png'])


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['photo.png'], 'photo.png: has colours'),
        (['grey.png', '--image-resolution', '1'], 'most frequent greys'),
        (['free.png'], 'no occupied cell'),
        (['tiny.png'], '3 x 1 pixels: expected a map of at least 5 x 5'),
        (['a.png', 'unlisted.png'], 'unlisted.png: resolution is not known'),
        (['nowhere.png'], 'nowhere.png: expected a readable image'),
        (['SOURCES.csv'], 'SOURCES.csv: expected a readable image'),
        (['a.png', 'a.png'], 'a.png: given twice'),
        (['a.png', '--sources', 'a.png'], 'a.png: expected a readable CSV'),
        (['a.png', '--resolution', '0'], 'resolution is 0.0'),
        (['a.png', '--resolution', '1.5'], '2 x 1 cells of 1.5 m'),
        (['a.png', '--image-resolution', '-1'], 'image_resolution is -1.0'),
        (['a.png', '--least', '0'], 'least is 0'),
        (['a.png', '--least', '100000'], 'least is 100000'),
        (['a.png', '--held-out'], '--held-out: expected at least two maps'),
        (['a.png', '--resolution', '0.01', '--coarser', 'skip'], 'all maps are coarser'),
        (['a.png', '-o', 'a.png'], 'a.png: is a file to read; expected a new name'),
        (['a.png', '-o', 'SOURCES.csv'], 'SOURCES.csv: is a file to read'),
        (['a.png', '-o', 'folder'], 'is a folder'),
        (['a.png', '-o', 'a.png/prior.npz'], 'expected a writable folder'),
    ],
    ids=lambda value: ' '.join(value)[:40] if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line_and_leaves_nothing(capsys, monkeypatch, maps, arguments, reason):
    rng = np.random.default_rng(1)
    save_room(maps / 'photo.png', colours=True)
    save_room(maps / 'unlisted.png')
    Image.fromarray(rng.integers(0, 256, (30, 40)).astype(np.uint8)).save(maps / 'grey.png')
    Image.fromarray(np.full((30, 40), 255, np.uint8)).save(maps / 'free.png')
    Image.fromarray(np.array([[0, 127, 255]], np.uint8)).save(maps / 'tiny.png')
    (maps / 'folder').mkdir()
    before = sorted(maps.rglob('*'))
    output = () if '-o' in arguments else ('-o', 'prior.npz')
    monkeypatch.chdir(maps)
    assert run(['learn-prior', *arguments, *output, '--json']) == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    (line,) = shown.err.splitlines()
    assert reason in line
    assert sorted(maps.rglob('*')) == before


@pytest.mark.data
def test_the_shipped_prior_is_learned_anew(run_cli, data_folder, tmp_path):
    images = sorted((data_folder / 'maps').glob('*.png'))
    done = run_cli('learn-prior', *images, '-o', 'buildings.npz', '--json')
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / 'buildings.npz') as here, np.load(default_prior_file()) as there:
        assert here.files == there.files
        for name in here.files:
            assert np.array_equal(here[name], there[name]), name
