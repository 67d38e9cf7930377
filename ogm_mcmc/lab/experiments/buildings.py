"""The recorded buildings of [patch] section IV, and what the paper reports of them.

Experiments 1 to 3, the Intel Research Lab: log recorded by Dirk Haehnel (Radish, CC-BY).

Experiments 4 to 6, the MIT Stata Center: Fallon, Johannsson, Kaess, Leonard, IJRR 2013 (CC BY
3.0). [patch] takes 1977 poses and does not say of which bag, nor where its window lies: here the
first 1977 of the bag that is there, and the window is around the middle of where the laser was.
The bags are larger than anyone would ship; `import-stata` makes of one of them and its poses what
is read here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ogm_mcmc.engine.bag_scans import PlacedScans, StreamChoice, choose_topics
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.io import messages
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.lab.experiments.hardware_sets import HardwareSet, Published
from ogm_mcmc.lab.experiments.recordings import as_scan

__all__ = ['INTEL', 'STATA', 'read_stata']

POSES = 1977


def read_intel(path: Path) -> list[PlacedScan]:
    """Read the 910 scans with corrected poses of the laser."""
    return [
        PlacedScan.at(as_scan(logged), logged.laser_pose) for logged in read_carmen(path).scans
    ]


def read_stata(path: Path) -> list[PlacedScan]:
    """Read one scan for each of the first 1977 poses: the one nearest to it in time.

    The laser scans twice as often as the poses come, and a pose has the stamp of its scan, so
    this is the scan that was aligned; its pose is interpolated at its own stamp all the same.
    Raises BagError when next to nothing can be placed.
    """
    choice = StreamChoice(scan_topic='/scan', pose_topic='/pose')
    with BagReader(path) as bag:
        topics = choose_topics(bag, choice)
        known = (bag.decode(record) for record in bag.records((topics.pose_name,)))
        poses_ns = np.array([messages.stamp_of(message) for message in known])[:POSES]
        placed = list(PlacedScans(bag, topics, choice))
    if len(placed) < 2:
        raise BagError(
            f'{path}: {len(placed)} scans between two poses: expected a bag from import-stata'
        )
    scans_ns = np.array([scan.stamp_ns for scan, _ in placed])
    halfway_ns = (scans_ns[:-1] + scans_ns[1:]) // 2
    return [placed[k] for k in np.unique(np.searchsorted(halfway_ns, poses_ns))]


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

STATA = HardwareSet(
    name='stata',
    path=Path('stata') / 'imported',
    expected='OGM_MCMC_DATA to name a folder with the bag that '
    '`ogm_mcmc import-stata BAG --poses CSV -o {path}` writes',
    read=read_stata,
    side_m=50.0,
    centre_m=None,
    pose_strides={4: 1, 5: 10, 6: 100},
    beam_stride=10,
    # "3.3 cm" and 2.25 million cells.
    resolutions_m=(1.0 / 30.0,),
    quick_resolution_m=0.1,
    held_out_scans=128,
    figure='Fig. 8',
    published=Published(
        resolution_m=1.0 / 30.0,
        benchmark_mapped=0.1621,
        mapped={4: 0.1458, 5: 0.1174, 6: 0.0523},
        near=0.2409,
        seconds={
            'border9': {4: 1734.0, 5: 201.2, 6: 33.14},
            'patch9': {4: 4158.0, 5: 557.2, 6: 44.71},
        },
    ),
    notes=(
        '[patch] does not say which bag it takes its 1977 poses from, nor where its window lies.',
        'MIT Stata Center: Fallon, Johannsson, Kaess, Leonard, IJRR 2013 (CC BY 3.0).',
    ),
)
