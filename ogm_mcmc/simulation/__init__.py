"""A small simulated building, a lidar in it, and a robot that walks through: real input for free.

Walls are line segments, so that a range is exact whatever the grid; nothing here knows cells.
"""

from ogm_mcmc.simulation.lidar import Lidar, true_ranges
from ogm_mcmc.simulation.recording import SimulatedScan, record
from ogm_mcmc.simulation.sonar import SonarReading, SonarRing
from ogm_mcmc.simulation.trajectories import walk
from ogm_mcmc.simulation.worlds import WORLDS, Building

__all__ = [
    'WORLDS',
    'Building',
    'Lidar',
    'SimulatedScan',
    'SonarReading',
    'SonarRing',
    'record',
    'true_ranges',
    'walk',
]
