"""Files with bytes and fields changed at random: read, or refused in one line, by every loader."""

import io
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.fuzz import ROUNDS, SEED
from support.strategies import fan

from ogm_mcmc.config import (
    AdaptiveConfig,
    ForwardModelConfig,
    LearningConfig,
    MapperConfig,
    WindowConfig,
    flatten,
)
from ogm_mcmc.engine.prior_files import Prior, load_prior, save_prior
from ogm_mcmc.engine.saved_chains import load_chains, save_chains
from ogm_mcmc.engine.tree_files import load_tree
from ogm_mcmc.errors import OgmError
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.io.map_files import load_map, load_npz, save_npz, write_tables
from ogm_mcmc.io.parameter_files import read_parameter_file
from ogm_mcmc.io.sample_files import MapSamples, load_samples, save_samples
from ogm_mcmc.io.training_maps import MapSource, read_training_map
from ogm_mcmc.io.world_files import load_image
from ogm_mcmc.mapping.adaptive import AdaptiveMapper
from ogm_mcmc.sampling import CellModel, PosteriorSampler, RayWindow
from ogm_mcmc.sampling.patch_learning import count_map

MAP_YAML = (
    b'image: map.pgm\nmode: scale\nresolution: 0.05\norigin: [-1.0, 2.5, 0.0]\n'
    b'negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n'
)
PARAMETERS = (
    b"/**:\n  ros__parameters:\n    resolution: 0.05\n    step: {l_occ: 1.4, 'l_free': -1}\n"
)


def map_npz(path):
    rng = np.random.default_rng(1)
    save_npz(GridMap(GridSpec(0.1, 9, 7), rng.random((7, 9), np.float32)), path, {'a': 1})


def prior_npz(path):
    states = np.random.default_rng(3).integers(-1, 2, (12, 12)).astype(np.int8)
    config = LearningConfig()
    sources = (MapSource('a.png', 0.05, 'somebody/maps', 'abc', 'MIT'),)
    save_prior(Prior(count_map(states, config), flatten(config), sources), path)


def tree_npz(path):
    method = AdaptiveMapper(
        MapperConfig(method='adaptive', adaptive=AdaptiveConfig(coarsest_level=3))
    )
    method.update(PlacedScan.at(fan(1.0), Pose2D(0.05, 0.05)))
    write_tables(method.extras(method.spec.box).tables, flatten(method.config), path.parent, 'a')
    (path.parent / 'a_tree.npz').rename(path)


def samples_npz(path):
    rng = np.random.default_rng(4)
    maps = rng.integers(0, 2, (5, 3, 7), np.uint8)
    touched = rng.integers(0, 2, (3, 7)).astype(bool)
    samples = MapSamples(GridSpec(0.5, 7, 3), maps, touched, touched, 0.3)
    save_samples(samples, path, 3, {'seed': 1})


def small_model():
    window = RayWindow(WindowConfig(resolution=0.5), ForwardModelConfig(sigma=0.6))
    window.add([PlacedScan.at(fan(1.6, 1.9, increment=0.5, range_max_m=3.0), Pose2D(0.3, 0.4))])
    return CellModel(window.index, 0.0, window.spec.width)


def chains_npz(path):
    model = small_model()
    starts = [np.zeros(model.n_cells, np.uint8)] * 2
    sampler = PosteriorSampler(model, starts, seed=1, burn_in=2)
    sampler.advance(6)
    save_chains(sampler, path, {'sigma': 1.0})


def chains_of(path):
    return load_chains(path, small_model())


ARCHIVES = {
    'map': (map_npz, load_npz),
    'prior': (prior_npz, load_prior),
    'tree': (tree_npz, load_tree),
    'samples': (samples_npz, load_samples),
    'chains': (chains_npz, chains_of),
}


def changed_bytes(content, rng):
    """Change, cut out or double a few bytes, or cut off the end."""
    content = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        at, length = int(rng.integers(len(content))), int(rng.integers(1, 9))
        kind = rng.integers(4)
        if kind == 0:
            content[at] = rng.integers(256)
        elif kind == 1:
            content[at] ^= 1 << rng.integers(8)
        elif kind == 2:
            content[at : at + length] = []
        else:
            content[at:at] = content[at : at + length]
        if not content:
            break
    return bytes(content)


def with_a_changed_member(content, rng):
    """Change the bytes of one array, its header most often, in an archive that is whole."""
    source = zipfile.ZipFile(io.BytesIO(content))
    names = source.namelist()
    chosen = names[rng.integers(len(names))]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, 'w') as target:
        for name in names:
            member = source.read(name)
            if name == chosen:
                head = rng.choice([128, len(member)])
                member = changed_bytes(member[:head], rng) + member[head:]
            target.writestr(name, member)
    return buffer.getvalue()


EXTREMES = [0, 1, -1, 255, 2**31, 2**62, -(2**63), np.nan, np.inf, -np.inf, 1e300, 5e-324]


def with_a_changed_value(content, rng):
    """Put an extreme value, another shape or another type into one array."""
    arrays = dict(np.load(io.BytesIO(content)))
    name = list(arrays)[rng.integers(len(arrays))]
    array = arrays[name].copy()
    kind = rng.integers(4)
    if array.dtype.kind == 'U':
        text = changed_bytes(str(array).encode(), rng).decode('utf-8', 'replace')
        array = np.array(text.replace('\0', '0'))
    elif kind < 2 and array.size:
        with np.errstate(all='ignore'):
            value = np.array(EXTREMES)[rng.integers(len(EXTREMES))].astype(array.dtype)
        array.reshape(-1)[rng.integers(array.size)] = value
    elif kind == 2:
        array = np.array([array, array]) if rng.integers(2) else array.reshape(-1)[:-1]
    else:
        with np.errstate(all='ignore'):
            array = array.astype(rng.choice(['f2', 'i1', 'u8', 'c8', '>f8', 'U3', '?', 'M8[s]']))
    buffer = io.BytesIO()
    np.savez(buffer, **{**arrays, name: array})
    return buffer.getvalue()


def outcome(load, path):
    """Return 'read' or 'refused'; any other exception of a loader fails the test."""
    try:
        load(path)
    except OgmError as error:
        return 'refused' if str(error).splitlines() == [str(error)] else 'refused in many lines'
    return 'read'


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('change', [changed_bytes, with_a_changed_member, with_a_changed_value])
@pytest.mark.parametrize('name', ARCHIVES)
def test_archives(tmp_path, name, change):
    write, load = ARCHIVES[name]
    path = tmp_path / 'a.npz'
    write(path)
    whole = path.read_bytes()
    assert outcome(load, path) == 'read'
    rng = np.random.default_rng(SEED)
    outcomes = Counter()
    for _ in range(ROUNDS):
        with np.errstate(all='ignore'):
            path.write_bytes(change(whole, rng))
        outcomes[outcome(load, path)] += 1
    assert outcomes['refused'] > ROUNDS // 10
    assert set(outcomes) <= {'read', 'refused'}


def image_bytes(format, mode):
    greys = np.random.default_rng(5).choice([0, 205, 254], (9, 8)).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(greys).convert(mode).save(buffer, format=format)
    return buffer.getvalue()


IMAGES = [('PPM', 'L'), ('PNG', 'L'), ('PNG', 'P'), ('PNG', 'RGBA'), ('BMP', 'L'), ('TIFF', 'L'),
          ('GIF', 'P'), ('JPEG', 'L')]  # fmt: skip


@pytest.mark.parametrize(('format', 'mode'), IMAGES)
def test_images(tmp_path, format, mode):
    path = tmp_path / 'map.image'
    whole = image_bytes(format, mode)
    rng = np.random.default_rng(SEED)
    outcomes = Counter()
    for load in (lambda p: load_image(p, 0.1), lambda p: read_training_map(p, {}, 0.1)):
        for _ in range(ROUNDS // 2):
            path.write_bytes(changed_bytes(whole, rng))
            outcomes[outcome(load, path)] += 1
    assert outcomes['refused'] > 0
    assert set(outcomes) <= {'read', 'refused'}


@pytest.mark.parametrize(
    ('content', 'load'), [(MAP_YAML, load_map), (PARAMETERS, read_parameter_file)]
)
def test_yaml(tmp_path, content, load):
    path: Path = tmp_path / 'map.yaml'
    (tmp_path / 'map.pgm').write_bytes(image_bytes('PPM', 'L'))
    path.write_bytes(content)
    assert outcome(load, path) == 'read'
    rng = np.random.default_rng(SEED)
    outcomes = Counter()
    for _ in range(2 * ROUNDS):
        path.write_bytes(changed_bytes(content, rng))
        outcomes[outcome(load, path)] += 1
    assert outcomes['refused'] > ROUNDS // 10
    assert set(outcomes) <= {'read', 'refused'}
