"""Refined beside live maps: what is judged, by which beams, images mapped without themselves."""

import math

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.engine.prior_files import load_prior
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.io.training_maps import MapSource
from ogm_mcmc.lab.experiments import refined_truth, true_worlds
from ogm_mcmc.lab.experiments.scoring import against_cells
from ogm_mcmc.simulation import GridWorld, Lidar


def room() -> true_worlds.TrueDrive:
    """A square room of 3 m with four scans of 40 beams."""
    occupied = np.zeros((34, 34), np.uint8)
    occupied[[0, -1]] = occupied[:, [0, -1]] = 1
    world, lidar = GridWorld(GridSpec(0.1, 34, 34), occupied), Lidar(40, dropout=0.0)
    rng = np.random.default_rng(3)
    scans = []
    for k, x in enumerate((0.7, 1.3, 1.9, 2.5)):
        pose = Pose2D(x, 1.75, 0.2 * k)
        exact = world.ranges(pose, lidar.bearings(), 12.0)
        scans.append(PlacedScan.at(lidar.scan(lidar.observe(exact, rng), k), pose))
    return true_worlds.TrueDrive(scans, world.truth(), 0.1)


def test_a_room_is_mapped_of_the_same_beams_and_judged(monkeypatch):
    monkeypatch.setattr(refined_truth, 'drive_through', lambda *_: room())
    monkeypatch.setattr(refined_truth, 'warm_up_sampling', lambda config: None)  # no clock counts
    monkeypatch.setattr(refined_truth, 'MOST_SWEEPS', 51)
    found = refined_truth.score('building-10', 2, 1)
    assert (found['scans'], found['rays'], found['chains']) == (4, 80, 16)
    # Two of the scans judge, by the beams between those that are mapped.
    assert found['nats']['beams'] == 40
    assert found['nats']['refined'] > found['nats']['live']
    assert found['refined']['brier'] < found['live']['brier']
    better, of = refined_truth.ahead([found])
    assert of == 5
    assert 3 <= better <= 5
    table = refined_truth.table_of([found]).splitlines()
    assert len({line.count('|') for line in table}) == 1
    assert table[2].startswith('| building 10, one of 2 beams | 80 | 16 | ')
    assert f'| {found["live"]["brier"]:.4f} / {found["refined"]["brier"]:.4f} |' in table[2]


def test_judging_beams_are_half_way_between_those_that_map():
    scans = room().scans
    flat = GridMap(GridSpec(0.1, 34, 34), np.full((34, 34), 0.5, np.float32))
    asked = []

    def noted(_, between, *__, **___):
        asked.append(list(between))
        return np.zeros(2)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(refined_truth, 'beam_log_likelihood', noted)
        refined_truth._nats(scans, 4, (flat, flat))
    assert refined_truth._nats(scans, 1, (flat, flat)) is None
    assert len(asked[0]) == 2
    mapped, judging = scans[0].scan.thinned(4).bearings(), asked[0][0].scan.bearings()
    assert judging - mapped == pytest.approx(2.0 * math.radians(9.0))
    assert np.array_equal(asked[0][1].scan.ranges_m, scans[3].scan.ranges_m[2::4])


def test_ahead_counts_what_is_as_good_with_less_for_errors():
    same = {'best_f1': 0.9, 'f1': 0.9, 'roc_area': 0.9, 'brier': 0.1, 'calibration_error': 0.1}
    assert refined_truth.ahead([{'live': same, 'refined': same}]) == (5, 5)
    worse = {**same, 'brier': 0.2, 'f1': 0.8}
    assert refined_truth.ahead([{'live': same, 'refined': worse}]) == (3, 5)
    assert refined_truth.ahead([{'live': worse, 'refined': same}]) == (5, 5)


def test_figures_of_cells_are_those_of_a_plain_count():
    rng = np.random.default_rng(5)
    probability, occupied = rng.random(400), rng.random(400) < 0.4
    found = against_cells(probability, occupied)
    called = probability >= 0.5
    true = (called & occupied).sum()
    assert found['f1'] == pytest.approx(2.0 * true / (called.sum() + occupied.sum()))
    assert found['brier'] == pytest.approx(np.mean((probability - occupied) ** 2))
    above = probability[occupied][:, None] > probability[~occupied][None, :]
    assert found['roc_area'] == pytest.approx(above.mean())
    tens = np.floor(10.0 * probability)
    errors = [abs((probability - occupied)[tens == k].sum()) for k in range(10)]
    assert found['calibration_error'] == pytest.approx(sum(errors) / 400.0)


@pytest.fixture
def three_images(tmp_path, monkeypatch):
    """Three images of a room with a wall across, and a data folder that holds them."""
    (tmp_path / 'maps').mkdir()
    sources = {}
    for k, name in enumerate(('one', 'two', 'fine')):
        grey = np.full((40, 40), 127, np.uint8)
        grey[5:35, 5:35] = 0
        grey[7:33, 7:33] = 255
        grey[7:33, 10 + 6 * k] = 0
        Image.fromarray(grey).save(tmp_path / 'maps' / f'{name}.png')
        sources[name] = MapSource(f'{name}.png', 0.02 if name == 'fine' else 0.05, 'somebody/maps')
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path))
    monkeypatch.setattr(true_worlds, 'images', lambda: sources)
    monkeypatch.setattr(true_worlds, 'ROBOT_RADIUS_M', 0.1)
    true_worlds._learned.cache_clear()
    yield tmp_path
    true_worlds._learned.cache_clear()


def test_an_image_is_driven_through_in_its_cells_finer_ones_pooled(three_images):
    drive = true_worlds.drive_through('two', 1)
    assert (drive.cell_m, drive.truth.probability.shape) == (0.05, (40, 40))
    inside = drive.truth.probability[7:33, 7:33]
    assert inside.sum() == 26  # the wall across; row 0 of a map is the last of its image
    assert drive.truth.probability[0, 0] == 1.0
    fine = true_worlds.drive_through('fine', 1)
    assert (fine.cell_m, fine.truth.probability.shape) == (0.05, (16, 16))
    assert np.isfinite(fine.scans[0].scan.ranges_m).any()


def test_an_image_has_no_part_in_its_prior(three_images):
    path = true_worlds.prior_without('two', three_images / 'prior.npz')
    prior = load_prior(path)
    assert [one.file for one in prior.sources] == ['one.png', 'fine.png']
    both = true_worlds._learned(('one', 'fine')).counts
    assert np.array_equal(prior.counts.squares.windows, both.squares.windows)
    all_three = true_worlds._learned(('one', 'two', 'fine')).counts
    assert all_three.cells.sum() > both.cells.sum()


def test_an_image_that_is_missing_is_one_line(three_images):
    (three_images / 'maps' / 'two.png').unlink()
    with pytest.raises(
        ConfigError, match=r'two.png: no such file; expected OGM_MCMC_DATA to name'
    ):
        true_worlds.drive_through('two', 1)


def test_shipped_images_are_those_of_the_table():
    assert len(true_worlds.images()) == 12
    assert true_worlds.images()['home_ex3'].resolution_m == 0.02


def test_parts_are_kept_by_what_images_show(three_images, monkeypatch):
    found = []

    def asked(*_, depends_on, **__):
        found.append(depends_on['images'])
        raise RuntimeError

    monkeypatch.setattr(refined_truth, 'images', true_worlds.images)
    monkeypatch.setattr(refined_truth, 'run_all', asked)
    for name in ('two', 'one'):
        image = (three_images / 'maps' / f'{name}.png').read_bytes()
        (three_images / 'maps' / 'two.png').write_bytes(image)
        with pytest.raises(RuntimeError):
            refined_truth.run(three_images / 'out', quick=False, seed=1)
    assert found[0]['one'] == found[1]['one'] == found[1]['two'] != found[0]['two']
