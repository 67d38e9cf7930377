"""The map of a recording, by the method that the settings name."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.no_returns import NoReturnChoice, NoReturnWatch, no_return_of
from ogm_mcmc.errors import GridError
from ogm_mcmc.mapping import Prediction, predictor
from ogm_mcmc.pipeline import MappingPipeline

__all__ = ['RecordedMap', 'check_mapping', 'map_recording', 'predicted_at']

# So many scans are read ahead to see what no return means, and no more: they take memory.
AHEAD = 5000


class RecordedMap(NamedTuple):
    """A map, what no return meant in it, and why the first scan was refused that led too far."""

    pipeline: MappingPipeline
    no_return: NoReturnChoice
    refused: str


def check_mapping(config: MapperConfig, *, at_points: bool) -> None:
    """Raise ConfigError, before any work, for settings that the method refuses.

    With `at_points` also for a method that knows of cells alone.
    """
    pipeline = MappingPipeline(config)
    if at_points:
        predicted_at(pipeline, np.empty((0, 2)))


def predicted_at(pipeline: MappingPipeline, points: Float64Array) -> Prediction:
    """Return log-odds and variance at any points (N, 2), m.

    Raises ConfigError for a method that knows of cells alone.
    """
    return predictor(pipeline.config.method)(pipeline.method, points)


def map_recording(config: MapperConfig, scans: PlacedScans) -> RecordedMap:
    """Map what can be mapped. Raises GridError where no scan can."""
    refused = ''
    watch = NoReturnWatch(config.resolution, config.max_range)
    stream = iter(scans)
    first = list(itertools.islice(stream, AHEAD))
    if config.method == 'sonar':
        choice = NoReturnChoice.of_cones(config.no_return)
    else:
        choice = no_return_of(config.no_return, first, config.resolution, config.max_range)
    pipeline = MappingPipeline(replace(config, no_return=choice.value))
    for placed in itertools.chain(first, stream):
        watch.see(placed)
        try:
            pipeline.update(placed)
        except GridError as error:
            scans.placer.drop('scan_off_map')
            if not refused:
                refused = str(error)
                scans.tell(f'scan at {placed.scan.stamp_ns / 1e9:.3f} s left out: {refused}')
    if pipeline.scans_used == 0:
        raise GridError(refused)
    if watch.seen > AHEAD and config.method != 'sonar':
        choice = choice._replace(found=watch.judge())
    return RecordedMap(pipeline, choice, refused)
