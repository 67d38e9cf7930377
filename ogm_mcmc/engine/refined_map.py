"""What sampling in the background hands over: the map as it is now, and how far it has come."""

from __future__ import annotations

from typing import NamedTuple

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.engine.collision import collision_risk
from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.engine.no_returns import NoReturnChoice
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.engine.sensor_fit import SensorNumbers
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import GridMap, SampleBits
from ogm_mcmc.sampling.estimates import hide_uncertain
from ogm_mcmc.trajectory import TrajectoryProgress

__all__ = ['RefinedMap', 'WorkerStatus']


class RefinedMap(NamedTuple):
    """A refined map as it was handed over, nan where data says nothing; `number` rises by one.

    `drawn` is the mean of `draws` maps of all chains, which decides what is shown, with a value
    also where data says nothing; a cell of which nothing is known has `prior`. `trajectory` are
    the poses it was sampled at, where they are estimated; `samples` some of the maps, None while
    no sweep counts. `guess`, the live map of the same scans, says with a few draws what is known.
    `unknown`, given with `samples`, is what `collision_risk` takes unknown space for: finding it
    (`chance_of_unknown`) takes a pass over all of them, too long for every question.
    """

    number: int
    grid_map: GridMap
    drawn: GridMap
    prior: float
    draws: int
    scans: int
    stamp_ns: int
    final: bool
    trajectory: RefinedTrajectory | None = None
    samples: SampleBits | None = None
    guess: GridMap | None = None
    unknown: float | None = None

    def collision_risk(self, places: Float64Array, radius_m: float) -> Float64Array:
        """Return (N + 1,): how likely a disc meets something at each place, and on the way.

        places  (N, 2), m. Raises WindowError while there are no samples, and what
        `ogm_mcmc.engine.collision.collision_risk` raises.
        """
        if self.samples is None or self.unknown is None:
            raise WindowError('no sweep counts yet: no samples of the map')
        return collision_risk(self.samples, places, radius_m, self.unknown)

    def shown(self, margin: float) -> GridMap:
        """Return the map where draws are surer than the prior by `margin`: `hide_uncertain`."""
        return hide_uncertain(
            self.grid_map, self.prior, margin, self.draws, self.drawn, self.guess
        )


class WorkerStatus(NamedTuple):
    """What the worker does, how far it is, why it stopped, and what went wrong last.

    `chain_sweeps`: of the chains that are here, whatever scans they saw; a new order goes on from
    them, also one that comes while an index is built. `left_out`: scans of the order that the
    index had no room for; `model`: of beams, as they were found last. `poses_of_map` says at which
    poses chains are, `poses` how far joint ones are.
    """

    state: str = 'idle'  # idle, indexing, sampling, refining poses: nothing else is left to do
    scans: int = 0
    left_out: int = 0
    rays: int = 0
    merged: int = 0  # of these rays, with others that they run along with
    n_bytes: int = 0
    index_bytes: int = 0  # of these
    progress: Progress | None = None
    sensor: SensorNumbers | None = None
    no_return: NoReturnChoice | None = None
    model: ForwardModelConfig | None = None
    poses: TrajectoryProgress | None = None
    poses_of_map: str = ''
    stopped: str = ''
    error: str = ''
    chain_sweeps: int = 0

    @property
    def understood(self) -> tuple[NoReturnChoice | None, ForwardModelConfig | None]:
        """What was found of beams, for `Recording.understand`."""
        return self.no_return, self.model
