"""Maps side by side: the same part of the world, cell beside cell."""

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.saved_map import save_map
from ogm_mcmc.errors import MapFileError, OutputError
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_sheet import save_side_by_side

WHITE, BLACK, UNKNOWN = (255, 255, 255), (0, 0, 0), (190, 198, 208)


@pytest.fixture
def maps(tmp_path):
    """Two maps that overlap: 300 x 200 cells, and 250 x 220 further right and down."""
    rng = np.random.default_rng(2)
    paths = []
    for name, shape, column0, row0 in (('a', (200, 300), -40, 5), ('b', (220, 250), 30, -60)):
        p = rng.choice([0.0, 1.0, np.nan], shape).astype(np.float32)
        grid_map = GridMap(GridSpec(0.05, shape[1], shape[0], column0, row0), p)
        paths.append((grid_map, save_map(grid_map, tmp_path, OutputConfig(), name)['yaml']))
    return paths


def test_every_cell_is_where_it_belongs(maps, tmp_path):
    path = tmp_path / 'maps.png'
    titled = [(yaml.stem, yaml) for _, yaml in maps]
    size = save_side_by_side(titled, path, 'A caption. ' * 20)
    with Image.open(path) as opened:
        assert opened.size == size
        pixels = np.asarray(opened.convert('RGB'))
    # Columns -40 to 280 and rows -60 to 205, twice as large, with a margin of 12 pixels.
    assert size[0] == 12 + 2 * (2 * 320 + 12)
    for i, (grid_map, _) in enumerate(maps):
        left, top = 12 + i * 652, 30
        part = pixels[top : top + 2 * 265, left : left + 2 * 320]
        whole = np.full((265, 320), np.nan, np.float32)
        spec = grid_map.spec
        rows = slice(spec.row0 + 60, spec.row0 + 60 + spec.height)
        whole[rows, spec.column0 + 40 : spec.column0 + 40 + spec.width] = grid_map.probability
        expected = np.full((265, 320, 3), UNKNOWN, np.uint8)
        expected[whole == 0.0], expected[whole == 1.0] = WHITE, BLACK
        expected = expected[::-1].repeat(2, axis=0).repeat(2, axis=1)
        assert np.array_equal(part, expected)
    # Titles above and several lines of caption below, black on white.
    assert (pixels[:30] == 0).any()
    caption = pixels[30 + 2 * 265 + 12 :]
    assert caption.shape[0] >= 60
    assert (caption[:30] < 100).any()
    assert (caption[-30:] < 100).any()


def test_what_is_no_map_is_refused_and_nothing_written(maps, tmp_path):
    (_, first), (_, second) = maps
    second.with_suffix('.png').unlink()
    path = tmp_path / 'maps.png'
    with pytest.raises(MapFileError, match='expected a saved map and its PNG'):
        save_side_by_side([('a', first), ('b', second)], path, '')
    for text in ('resolution: 0\norigin: [0, 0, 0]\n', 'origin: 1\n', '- 1\n', '{'):
        second.write_text(text)
        with pytest.raises(MapFileError, match=f'^{second}: '):
            save_side_by_side([('b', second)], path, '')
    assert not path.exists()
    with pytest.raises(OutputError, match='cannot be written'):
        save_side_by_side([('a', first)], tmp_path / 'none' / 'maps.png', '')
