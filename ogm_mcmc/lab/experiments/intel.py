"""The Intel Research Lab, experiments 1 to 3 of [patch] section IV.

Log recorded by Dirk Haehnel (Radish, CC-BY).
"""

from __future__ import annotations

from pathlib import Path

from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.lab.experiments.hardware_sets import HardwareSet, Published
from ogm_mcmc.lab.experiments.recordings import as_scan

__all__ = ['INTEL']


def read_intel(path: Path) -> list[PlacedScan]:
    """Read the 910 scans with corrected poses of the laser."""
    return [
        PlacedScan.at(as_scan(logged), logged.laser_pose) for logged in read_carmen(path).scans
    ]


INTEL = HardwareSet(
    name='intel',
    path=Path('intel') / 'intel.gfs.log',
    expected='OGM_MCMC_DATA to name a folder with intel/intel.gfs.log (Radish)',
    read=read_intel,
    side_m=30.0,
    # The middle between the outer walls.
    centre_m=(4.05, -8.8),
    pose_strides={1: 1, 2: 2, 3: 10},
    beam_stride=2,
    resolutions_m=(0.05, 0.02),
    quick_resolution_m=0.05,
    held_out_scans=455,
    figure='Fig. 7',
    published=Published(
        resolution_m=0.02,
        benchmark_mapped=0.5963,
        mapped={1: 0.5578, 2: 0.5027, 3: 0.2822},
        near=0.7304,
        seconds={
            'border9': {1: 1518.0, 2: 723.6, 3: 166.8},
            'patch9': {1: 6433.0, 2: 3023.0, 3: 306.1},
        },
    ),
    notes=('Log recorded by Dirk Haehnel at the Intel Research Lab (Radish, CC-BY).',),
)
