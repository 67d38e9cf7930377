"""Fixtures that several modules of commands share."""

import json

import numpy as np
import pytest
from support.small_maps import ESTIMATE, NAN, TRUTH
from support.strategies import fan

from ogm_mcmc.cli.main import run
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.saved_map import save_map
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.io.map_files import save_npz
from ogm_mcmc.io.recording_bag import write_recording

SECOND = 1_000_000_000


@pytest.fixture
def maps(tmp_path):
    """map.npz (probabilities) and truth.yaml of the same cells."""
    spec = GridSpec(0.1, 4, 3, column0=5, row0=-2)
    save_npz(GridMap(spec, ESTIMATE), tmp_path / 'map.npz', {'made': 'by hand'})
    save_map(GridMap(spec, TRUTH), tmp_path, OutputConfig(), 'truth')
    return tmp_path


@pytest.fixture
def bag(maps):
    """Scans along the lowest row, to the right and to the left, and one that says nothing."""
    scans = [
        PlacedScan.at(
            fan(0.2, np.inf, 0.05, increment=1e-6, range_max_m=0.3, stamp_ns=SECOND),
            Pose2D(0.55, -0.15),
        ),
        PlacedScan.at(fan(0.2, range_max_m=0.3, stamp_ns=2 * SECOND), Pose2D(0.55, -0.15, np.pi)),
        PlacedScan.at(fan(NAN, range_max_m=0.3, stamp_ns=3 * SECOND), Pose2D(0.55, -0.15)),
    ]
    assert write_recording(maps / 'bag', scans) == 3
    return maps / 'bag'


@pytest.fixture
def sample(office_bag, tmp_path, monkeypatch, capsys):
    """Run `sample` on the office in this process; returns its JSON."""
    monkeypatch.chdir(tmp_path)

    def call(*options):
        capsys.readouterr()
        assert run(['sample', str(office_bag), *map(str, options)]) == 0
        return json.loads(capsys.readouterr().out)

    return call
