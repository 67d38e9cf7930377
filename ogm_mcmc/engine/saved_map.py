"""A map and all that belongs to it, written as one set: the door of the node and of `map`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ogm_mcmc.config import OutputConfig, flatten
from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.engine.map_view import rendered
from ogm_mcmc.errors import OutputError
from ogm_mcmc.files.output_files import replacing_set
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.io.map_files import points_file, table_file, write_map, write_tables
from ogm_mcmc.io.tum_files import deviations_file, write_beliefs
from ogm_mcmc.mapping import Extras, all_tables
from ogm_mcmc.pipeline import MappingPipeline

__all__ = [
    'MapToSave',
    'replacing_map',
    'save_map',
    'save_refined',
    'saved_text',
    'write_shown',
]


def saved_text(grid_map: GridMap, path: Path) -> str:
    """Return what a node answers when it has saved a map: where, how large, how much is known."""
    height, width = grid_map.probability.shape
    known = float(np.isfinite(grid_map.probability).mean()) if grid_map.probability.size else 0.0
    return (
        f'{path.absolute()}: {width} x {height} cells of {grid_map.spec.resolution_m:g} m, '
        f'{100.0 * known:.1f} % of them known'
    )


def write_shown(grid_map: GridMap, folder: Path, output: OutputConfig, name: str) -> None:
    """Write a map's PGM, YAML and PNG into a folder, as part of a set; see `write_map`."""
    write_map(grid_map, rendered(grid_map.probability, 'trinary', output), folder, name)


def save_map(
    grid_map: GridMap, folder: Path, output: OutputConfig, name: str = 'map'
) -> dict[str, Path]:
    """Write NAME.pgm, NAME.yaml and NAME.png in place of an old set; return their paths.

    Raises OutputError.
    """
    with replacing_set(folder, name) as scratch:
        write_shown(grid_map, scratch, output, name)
    return {kind: folder / f'{name}.{kind}' for kind in ('pgm', 'yaml', 'png')}


class MapToSave:
    """The map of a pipeline as it is now, and what its method saves beside it."""

    def __init__(self, pipeline: MappingPipeline) -> None:
        self.grid_map: GridMap = pipeline.map()
        self.extras: Extras = pipeline.extras(self.grid_map.spec.box)
        self.settings = flatten(pipeline.config)


@contextlib.contextmanager
def replacing_map(
    saved: MapToSave, folder: Path, name: str, output: OutputConfig
) -> Iterator[Path]:
    """Write NAME.pgm, .yaml and .png and the tables of the method in place of an old set.

    Yields the folder of the new files before they take their places, so that more may be added.
    Tables that another method left under this name go, and points of another map. Raises
    OutputError.
    """
    stale = [table_file(name, one) for one in sorted(all_tables() - set(saved.extras.tables))]
    with replacing_set(folder, name, [*stale, points_file(name)]) as scratch:
        write_shown(saved.grid_map, scratch, output, name)
        write_tables(saved.extras.tables, saved.settings, scratch, name)
        yield scratch


def save_refined(
    grid_map: GridMap,
    trajectory: RefinedTrajectory | None,
    folder: Path,
    name: str,
    output: OutputConfig,
) -> Path:
    """Write a refined map, and its poses as NAME_trajectory.txt, in place of an old set.

    trajectory  poses that were refined with the map
    Returns the path of the YAML. What belongs to another map of this name goes. Raises
    OutputError; also where nothing is known yet, so that no good map is replaced by none.
    """
    if not np.isfinite(grid_map.probability).any():
        raise OutputError('nothing of the map is known yet: nothing to save; let it sample longer')
    poses = Path(f'{name}_trajectory.txt')
    stale = [*(table_file(name, one) for one in sorted(all_tables())), points_file(name)]
    stale += [str(poses), str(deviations_file(poses))]
    with replacing_set(folder, name, stale) as scratch:
        write_shown(grid_map, scratch, output, name)
        if trajectory is not None:
            of = trajectory
            write_beliefs(scratch / poses, of.stamps_ns, of.beliefs, of.apart)
    return folder / f'{name}.yaml'
