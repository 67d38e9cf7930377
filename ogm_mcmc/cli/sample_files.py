"""The files that `sample` leaves, written as one set."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float32Array, UInt8Array
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.saved_map import write_shown
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.npz_files import MOST_BYTES
from ogm_mcmc.files.output_files import replacing_set
from ogm_mcmc.files.processes import free_memory
from ogm_mcmc.geometry import CellBox, GridMap, GridSpec
from ogm_mcmc.geometry.grid_map import entropy_bits
from ogm_mcmc.io.map_files import save_npz
from ogm_mcmc.io.sample_files import MapSamples, save_samples
from ogm_mcmc.io.tum_files import deviations_file, write_beliefs
from ogm_mcmc.plotting import heat_png
from ogm_mcmc.sampling.estimates import hide_uncertain

__all__ = ['SampledMaps', 'check_room', 'write_all']


class SampledMaps(NamedTuple):
    """A posterior that was sampled, maps drawn from it (packed bits), and how to show it.

    `trajectory` are the poses it was sampled at, where they were estimated.
    """

    refinement: Refinement
    maps: list[UInt8Array]
    margin: float
    thin: int
    trajectory: RefinedTrajectory | None = None


def check_room(count: int, n_cells: int) -> None:
    """Raise ConfigError where so many maps of a window cannot be held, or be read again.

    `n_cells` of the window, or a little more. A cell of a map takes a byte while it is written.
    """
    needed, free = float(count) * n_cells, free_memory()
    if needed <= min(MOST_BYTES, free):
        return
    most, what = min((MOST_BYTES, 'a file of maps may hold'), (free, 'is free'))
    raise ConfigError(
        f'--samples {count}: maps of {n_cells} cells take {needed / 1e9:.4g} GB: expected at most '
        f'{int(most / n_cells)}, for the {most / 1e9:.3g} GB that {what}'
    )


def write_all(
    sampled: SampledMaps,
    output: OutputConfig,
    result: dict[str, Any],
    folder: Path,
    name: str,
) -> dict[str, str]:
    """Write map, NPZ, entropy, samples and JSON; return the paths by kind.

    The NPZ and the entropy have `Refinement.known_map`: nan where data did not move a cell. Layers
    of all cells that rays came to are `probability_everywhere` (`Refinement.map`), and
    `posterior_mean`, the mean of the draws alone: behind the first surface the prior alone speaks
    there, and draws it solid. PGM and PNG show where this mean is more certain than the prior
    (`hide_uncertain`). An old set is replaced as a whole.
    """
    refinement, settings = sampled.refinement, result['settings']
    assert refinement.sampler is not None
    estimate = refinement.sampler.estimate()
    mean = refinement.drawn_map(estimate).cropped()
    known = _on(mean.spec, refinement.known_map(estimate))
    paths = {kind: folder / f'{name}.{kind}' for kind in ('npz', 'png', 'pgm', 'yaml')}
    paths['entropy'] = folder / f'{name}_entropy.png'
    if sampled.maps:
        paths['samples'] = folder / f'{name}_samples.npz'
    trajectory = folder / f'{name}_trajectory.txt'
    of_poses = {'trajectory': trajectory, 'deviations': deviations_file(trajectory)}
    perhaps = {**of_poses, 'samples': folder / f'{name}_samples.npz'}
    if sampled.trajectory is not None:
        paths['trajectory'] = trajectory
        if sampled.trajectory.beliefs[0].covariance is not None:
            paths['deviations'] = of_poses['deviations']
    gone = [path.name for kind, path in perhaps.items() if kind not in paths]
    files = {kind: str(path) for kind, path in paths.items()}
    shape = {
        'width': mean.spec.width,
        'height': mean.spec.height,
        'origin': [mean.spec.origin_x_m, mean.spec.origin_y_m],
    }
    result.update(shape)
    with replacing_set(folder, name, gone) as scratch:
        layers = {
            'probability_everywhere': _on(mean.spec, refinement.map(estimate)).probability,
            'posterior_mean': mean.probability,
            **_layers(refinement, mean.spec.box),
        }
        shown = hide_uncertain(
            known,
            refinement.prior,
            sampled.margin,
            estimate.draws,
            mean,
            _on(mean.spec, refinement.guess),
        )
        write_shown(shown, scratch, output, name)
        save_npz(known, scratch / f'{name}.npz', settings, layers)
        entropy = heat_png(entropy_bits(known.probability), 1.0)
        (scratch / paths['entropy'].name).write_bytes(entropy)
        if sampled.maps:
            maps = _unpacked(sampled, mean, known)
            save_samples(maps, scratch / paths['samples'].name, sampled.thin, settings)
        if sampled.trajectory is not None:
            of = sampled.trajectory
            told = of.stamps_ns, of.beliefs, of.apart
            write_beliefs(scratch / paths['trajectory'].name, *told)
        (scratch / f'{name}.json').write_text(
            json.dumps({**result, 'files': files}, indent=2) + '\n', encoding='utf-8'
        )
    return files


def _on(spec: GridSpec, whole: GridMap) -> GridMap:
    """Return the part of a map that lies on other cells of its lattice."""
    rows, columns = whole.spec.slices(spec.box)
    return GridMap(spec, np.ascontiguousarray(whole.probability[rows, columns]))


def _layers(refinement: Refinement, box: CellBox) -> dict[str, Float32Array]:
    """Return `mcse`, `r_hat` and `ess` (height, width) of a box, nan where not known."""
    assert refinement.sampler is not None
    quality = refinement.sampler.quality()
    if quality is None:
        unknown = np.full(refinement.sampler.model.touched.size, np.nan, np.float32)
        values = {'mcse': unknown, 'r_hat': unknown, 'ess': unknown}
    else:
        values = {'mcse': quality.mcse, 'r_hat': quality.r_hat, 'ess': quality.ess}
    rows, columns = refinement.window.spec.slices(box)
    return {
        name: np.ascontiguousarray(refinement.grid_map(layer).probability[rows, columns])
        for name, layer in values.items()
    }


def _unpacked(sampled: SampledMaps, mean: GridMap, known: GridMap) -> MapSamples:
    """Return the maps drawn, cropped like the mean."""
    spec = sampled.refinement.window.spec
    place = spec.slices(mean.spec.box)
    maps = np.empty((len(sampled.maps), mean.spec.height, mean.spec.width), np.uint8)
    for drawn, packed in zip(maps, sampled.maps, strict=True):
        whole = np.unpackbits(packed, count=spec.height * spec.width)
        drawn[:] = whole.reshape(spec.height, spec.width)[place]
    touched, moved = np.isfinite(mean.probability), np.isfinite(known.probability)
    return MapSamples(mean.spec, maps, touched, moved, sampled.refinement.prior)
