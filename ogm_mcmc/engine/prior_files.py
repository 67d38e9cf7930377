"""Prior files: the counts of patches, and where they come from, as NPZ.

=====================  =======================================================================
field                  meaning
=====================  =======================================================================
version                of this format, 1
patch_size             9: 3 x 3 patches with their border, from windows of 5 x 5
resolution             side of a cell, m
cells                  (2,) int64, free and occupied cells
patches                (512,) int64, 3 x 3 windows by pattern, each counted in eight images
patterns, windows      (n,) int32, ascending, and int64: 5 x 5 windows by class of images
dropped                5 x 5 windows of classes that were too rare to be kept
options                YAML: the settings they were counted with
sources                YAML: a list of maps with file, resolution_m, source, commit, licence
=====================  =======================================================================

Bit order: `ogm_mcmc.sampling.patch_patterns`. Counts are kept, not probabilities: how much a
rare patch weighs is decided where a table is made.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.errors import PriorError
from ogm_mcmc.files.npz_files import TEXT, Field, npz_file
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.files.yaml_files import parse_yaml
from ogm_mcmc.io.training_maps import MapSource
from ogm_mcmc.sampling.patch_learning import PatchCounts, WindowCounts
from ogm_mcmc.sampling.patch_patterns import canonical

__all__ = ['Prior', 'default_prior_file', 'load_prior', 'resolution_warning', 'save_prior']

VERSION = 1
PATCH_SIZE = 9
DEFAULT_NAME = 'buildings.npz'
MOST_COUNTED = 2.0**62
FIELDS = {
    'version': Field('i'),
    'patch_size': Field('i'),
    'resolution': Field('f'),
    'cells': Field('i', (2,)),
    'patches': Field('i', (512,)),
    'patterns': Field('i', (None,)),
    'windows': Field('i', (None,)),
    'dropped': Field('i'),
    'options': TEXT,
    'sources': TEXT,
}

logger = logging.getLogger(__name__)


class Prior(NamedTuple):
    """What a prior file holds: counts, the settings they were counted with, and the maps."""

    counts: PatchCounts
    options: dict[str, Any]
    sources: tuple[MapSource, ...]


def save_prior(prior: Prior, path: Path) -> Path:
    """Write a prior file; raises OutputError when the place cannot be written to."""
    counts = prior.counts
    sources = [dataclasses.asdict(source) for source in prior.sources]
    with replacing(path) as temporary, temporary.open('wb') as stream:
        np.savez_compressed(
            stream,
            version=np.int64(VERSION),
            patch_size=np.int64(PATCH_SIZE),
            resolution=np.float64(counts.resolution_m),
            cells=counts.cells,
            patches=counts.patches,
            patterns=counts.squares.patterns,
            windows=counts.squares.windows,
            dropped=np.int64(counts.dropped),
            options=np.array(yaml.safe_dump(prior.options, sort_keys=False)),
            sources=np.array(yaml.safe_dump(sources, sort_keys=False)),
        )
    return path


def load_prior(path: Path, resolution_m: float | None = None) -> Prior:
    """Read and check a prior file.

    resolution_m  at which it is going to be used; another one than learned is warned about
    Raises PriorError with the field at fault.
    """
    fields = _read(path)
    _check(fields, path)
    try:
        options = _settings(parse_yaml(str(fields['options'])))
        sources = tuple(MapSource(**item) for item in parse_yaml(str(fields['sources'])))
    except (ValueError, TypeError) as error:
        raise PriorError(
            f'{path}: options, sources: expected YAML of settings and maps'
        ) from error
    counts = PatchCounts(
        float(fields['resolution']),
        fields['cells'].astype(np.int64),
        fields['patches'].astype(np.int64),
        WindowCounts(fields['patterns'].astype(np.int32), fields['windows'].astype(np.int64)),
        int(fields['dropped']),
    )
    if resolution_m is not None:
        remark = resolution_warning(counts, resolution_m)
        if remark:
            logger.warning('%s: %s', path, remark)
    return Prior(counts, options, sources)


def resolution_warning(counts: PatchCounts, resolution_m: float) -> str:
    """What to say when a prior is used at another resolution than learned; else empty."""
    if abs(counts.resolution_m - resolution_m) <= 1e-6 * resolution_m:
        return ''
    return (
        f'prior learned at {counts.resolution_m:g} m per cell, used at {resolution_m:g} m: '
        'walls are another number of cells thick'
    )


def _settings(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError('options')
    return value


def _read(path: Path) -> dict[str, AnyArray]:
    """Read all fields; the version first, since other versions may have other fields."""
    with npz_file(path, 'a complete prior file, NPZ', PriorError) as held:
        if 'version' in held.names and held.read('version', FIELDS['version']) != VERSION:
            found = held.read('version', FIELDS['version'])
            raise PriorError(f'{path}: version is {found}: expected {VERSION}; learn it anew')
        missing = [name for name in FIELDS if name not in held.names]
        if missing:
            raise PriorError(f'{path}: no field {missing[0]}: expected {", ".join(FIELDS)}')
        return {name: held.read(name, field) for name, field in FIELDS.items()}


def _check(fields: Mapping[str, AnyArray], path: Path) -> None:
    """Refuse what a table could not be made from."""
    if fields['patch_size'] != PATCH_SIZE:
        raise PriorError(f'{path}: patch_size is {fields["patch_size"]}: expected {PATCH_SIZE}')
    if not 0.0 < fields['resolution'] < 1000.0:
        raise PriorError(f'{path}: resolution is {fields["resolution"]}: expected metres per cell')
    patterns, windows = fields['patterns'], fields['windows']
    consistent = (
        patterns.size == windows.size > 0
        and patterns.min() >= 0
        and patterns.max() < 2**25
        and (patterns[1:] > patterns[:-1]).all()
        and windows.min() > 0
        and min(fields['cells'].min(), fields['patches'].min(), fields['dropped']) >= 0
        and 0 < _total(fields['cells']) < MOST_COUNTED
        and 0 < _total(fields['patches']) < MOST_COUNTED
        and _total(windows) < MOST_COUNTED
        and (canonical(patterns, 5) == patterns).all()
    )
    if not consistent:
        raise PriorError(f'{path}: patterns, windows: expected counts of ascending 5 x 5 patterns')


def _total(counts: AnyArray) -> float:
    """Return the sum, which whole numbers of 64 bits may be too short for."""
    return float(counts.sum(dtype=np.float64))


def default_prior_file() -> Path:
    """The prior that comes with the package, in `config/priors` or installed in `share`.

    One copy, where users of ROS look for it (`share/ogm_mcmc/priors`): setup.py installs it as
    data beside launch and parameter files. From the package it is found by walking up: the
    source tree is the folder above it, and whether pip, `--user`, `--target` or colcon installed
    it, `share` lies in the prefix that holds `site-packages`.
    """
    package = Path(__file__).resolve().parents[1]
    candidates = [package.parent / 'config' / 'priors']
    candidates += [above / 'share' / package.name / 'priors' for above in package.parents]
    for folder in candidates:
        if (folder / DEFAULT_NAME).is_file():
            return folder / DEFAULT_NAME
    raise PriorError(
        f'{DEFAULT_NAME}: not found in {candidates[0]} or share/{package.name}/priors of the '
        'installation: expected the prior that comes with the package; name one yourself'
    )
