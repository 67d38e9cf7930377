"""A map and all that belongs to it, written as one set: the door of the node and of `map`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ogm_mcmc.config import OutputConfig, flatten
from ogm_mcmc.files.output_files import replacing_set
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.io.map_files import points_file, table_file, write_map, write_tables
from ogm_mcmc.mapping import Extras, all_tables
from ogm_mcmc.pipeline import MappingPipeline

__all__ = ['MapToSave', 'replacing_map', 'saved_text']


def saved_text(grid_map: GridMap, path: Path) -> str:
    """Return what a node answers when it has saved a map: where, how large, how much is known."""
    height, width = grid_map.probability.shape
    known = float(np.isfinite(grid_map.probability).mean()) if grid_map.probability.size else 0.0
    return (
        f'{path.absolute()}: {width} x {height} cells of {grid_map.spec.resolution_m:g} m, '
        f'{100.0 * known:.1f} % of them known'
    )


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
        write_map(saved.grid_map, scratch, output, name)
        write_tables(saved.extras.tables, saved.settings, scratch, name)
        yield scratch
