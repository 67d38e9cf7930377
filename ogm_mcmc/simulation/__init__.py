"""Simulated buildings, a robot with a lidar or sonars: real input for free, and the truth with it.

Two kinds of worlds. A `Building` has walls that are line segments, so that a range is exact
whatever the grid; nothing in it knows cells, and the robot walks along given points. A
`GridWorld` is made of occupied cells, as the papers' simulations are: ten generated floors
(`generate_floor`), or any map. There the robot explores until everything is covered and scans
when it stands ([gibbs] section IV-B), at poses that are known, or only believed:
`record_localized` gives it odometry and a particle filter ([pose] section V). What a beam
measures in a grid is decided in `grid_world`. In place of the lidar the robot may carry a ring of
sonars (`SonarRing`), each of which hears the nearest wall in its cone.

`drive` lets the robot go round in either world and scan while it moves, at the sensor's rate.
"""

from ogm_mcmc.simulation.driving import DrivenScan, Driving, Nodes, drive, tour_of
from ogm_mcmc.simulation.exploration import Choice, Exploration, Stop, explore, seen_from
from ogm_mcmc.simulation.floor_plans import FLOOR_PLANS, generate_floor
from ogm_mcmc.simulation.grid_world import GridWorld
from ogm_mcmc.simulation.lidar import Lidar, true_ranges
from ogm_mcmc.simulation.localization import (
    LocalizedScan,
    ParticleFilter,
    ParticleFilterSettings,
    ScanFit,
    WorldFit,
    record_localized,
)
from ogm_mcmc.simulation.odometry import Motion, OdometryNoise, motion_between
from ogm_mcmc.simulation.recording import (
    record,
    record_exploration,
    record_exploration_with_sonars,
    record_with_sonars,
)
from ogm_mcmc.simulation.sonar import SonarRing
from ogm_mcmc.simulation.trajectories import walk
from ogm_mcmc.simulation.turned import Turned
from ogm_mcmc.simulation.worlds import WORLDS, Building, rasterised

__all__ = [
    'FLOOR_PLANS',
    'WORLDS',
    'Building',
    'Choice',
    'DrivenScan',
    'Driving',
    'Exploration',
    'GridWorld',
    'Lidar',
    'LocalizedScan',
    'Motion',
    'Nodes',
    'OdometryNoise',
    'ParticleFilter',
    'ParticleFilterSettings',
    'ScanFit',
    'SonarRing',
    'Stop',
    'Turned',
    'WorldFit',
    'drive',
    'explore',
    'generate_floor',
    'motion_between',
    'rasterised',
    'record',
    'record_exploration',
    'record_exploration_with_sonars',
    'record_localized',
    'record_with_sonars',
    'seen_from',
    'tour_of',
    'true_ranges',
    'walk',
]
