"""Settings of the full posterior: sensor model, window of rays, chains, when to stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ogm_mcmc.config.settings import check_bounds, setting
from ogm_mcmc.errors import require

__all__ = [
    'ChainConfig',
    'ForwardModelConfig',
    'PatchConfig',
    'SamplerConfig',
    'ShownConfig',
    'StopConfig',
    'WindowConfig',
    'check_limits',
]


@dataclass(frozen=True)
class ForwardModelConfig:
    """p(range | first occupied cell); see `ogm_mcmc.sensors.forward_model`."""

    kind: str = setting(
        'beam',
        'beam: a mixture of hits, clutter, short and missing returns; gaussian: hits only, N(f,'
        ' sigma^2)',
        choices=('beam', 'gaussian'),
    )
    sigma: float = setting(
        0.05,
        'standard deviation of a range, m; include the error of the poses',
        low=1e-4,
        high=10.0,
    )
    grazing: float = setting(
        0.0,
        'roughness of surfaces, m: standard deviation across the surface. This over the '
        'tangent of the angle between beam and surface adds to sigma (in quadrature); 0: not used',
        low=0.0,
        high=10.0,
    )
    clutter: float = setting(
        0.05, 'beam: share of ranges that are random (uniform)', low=1e-6, high=0.5
    )
    missing: float = setting(
        0.05, 'beam: share of beams that hit something but give no return', low=1e-6, high=0.5
    )
    short: float = setting(
        0.0,
        'beam: share of ranges from an object in front of the occupied cell',
        low=0.0,
        high=0.5,
    )
    short_decay: float = setting(
        1.0, 'beam: decay rate of the density of short ranges, 1/m', low=1e-3, high=100.0
    )
    depth: float = setting(
        0.5,
        'where in a cell a beam is reflected: 0: at its border, 0.5: in the middle',
        low=0.0,
        high=1.0,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds or leaves nothing for hits."""
        check_bounds(self)
        others = self.clutter + self.missing + self.short
        require(others < 1.0, 'clutter + missing + short', others, 'must be below 1')

    @property
    def sigma_m(self) -> float:
        """The sigma; where it is 0, to be found in scans, and nobody has looked, the default."""
        return float(self.sigma or ForwardModelConfig.sigma)

    @property
    def grazing_m(self) -> float:
        """How far surfaces are off; 0, too, where it is to be found and nobody has looked."""
        return max(float(self.grazing), 0.0)


@dataclass(frozen=True)
class WindowConfig:
    """Which rays are sampled, and how far they are followed."""

    resolution: float = setting(0.05, 'side of a cell, m', low=0.001, high=10.0)
    max_range: float = setting(
        0.0,
        'beams are used up to this range, m; a longer beam is free up to it; 0: up to range_max'
        ' of the scan',
        low=0.0,
        high=10000.0,
    )
    no_return: str = setting(
        'clear',
        'meaning of a range of +inf: clear: nothing on the ray up to range_max; ignore: not used',
        choices=('clear', 'ignore'),
    )
    beam_stride: int = setting(
        1,
        'use every n-th beam of a scan; properties of the sensor (chain.sensor, no_return) are '
        'estimated from all beams',
        low=1,
        high=10000,
    )
    cut_sigma: float = setting(
        6.0,
        'a ray is followed up to this many sigma behind its reading; 0: up to the maximum range',
        low=0.0,
        high=1000.0,
    )
    max_memory_mb: float = setting(
        2000.0, 'largest memory of the ray index, MB', low=1.0, high=1e6
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


# Below so many rays, so many chains where nobody says how many. Patches: independent cells forget
# in a few sweeps whatever they were.
CHAINS_BELOW = ((2_000, 16), (20_000, 8), (60_000, 4))
ENOUGH_CHAINS = 2
CHAINS_SAID = ', '.join(
    [*(f'{chains} below {most}' for most, chains in CHAINS_BELOW), f'else {ENOUGH_CHAINS}']
)


@dataclass(frozen=True)
class ChainConfig:
    """How the chains are started and run."""

    prior: float = setting(
        0.15, 'prior probability that a cell is occupied', low=1e-6, high=1.0 - 1e-6
    )
    chains: int = setting(
        2,
        f'number of chains, one thread each; 0: by the rays, {CHAINS_SAID} ({ENOUGH_CHAINS} of '
        'independent cells). With few beams, more chains give a better map that differs less from '
        'run to run. When chains go on with other scans their number never grows',
        low=0,
        high=64,
    )
    start: str = setting(
        'dispersed',
        'first map of a chain: live: the live map with a threshold; prior: a draw from the '
        'prior; free; occupied; dispersed: a different one of these for each chain, except that'
        ' cells free in the live map start free',
        choices=('dispersed', 'live', 'prior', 'free', 'occupied'),
    )
    start_threshold: float = setting(
        0.5,
        'cells of the live map are occupied from this probability; unmeasured cells have the '
        'prior',
        low=0.0,
        high=1.0,
    )
    order: str = setting(
        'fixed',
        'order of the cells in a sweep; checkerboard: the even cells first, then the odd cells',
        choices=('fixed', 'random', 'checkerboard'),
    )
    sensor: str = setting(
        'given',
        'clutter and missing of the beam model: given: as set; fitted: estimated from the scans '
        'that are sampled, as a sigma of 0 is',
        choices=('given', 'fitted'),
    )
    reflecting: float = setting(
        0.0,
        'weight of the share of beams that a cell reflected, of those that reached it, in its '
        'probability; the maps that were drawn have the rest. They take cells as free or solid, '
        'but edges, glass and legs are neither. A cell in which a beam ended is lowered only '
        'where sigma is above half a cell, with the full weight from 0.7 of a cell on. Where '
        'grazing beams show that walls are whole cells (model.grazing, found), the share counts '
        'only where the maps that were drawn differ',
        low=0.0,
        high=0.5,
    )
    neighbours: float = setting(
        0.0,
        'weight of each of the four neighbours in the probability of a cell about which all maps '
        'that were drawn agree: in full where sigma is 0.7 of a cell or more, none up to half a '
        'cell. The borders of cells are arbitrary, and a reading may belong to the next cell',
        low=0.0,
        high=0.25,
    )
    burn_in: int = setting(
        50,
        'largest number of sweeps of each chain that are not counted. Of 40 or more, the second '
        'half is shortened, by eighths, where the chains agree. At most 16 for chains that go on '
        'with up to a tenth of new scans, also after a correction of the others',
        low=0,
        high=10**9,
    )
    seed: int = setting(1, 'seed of the chains', low=0, high=2**63 - 1)

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

    @property
    def prior_log_odds(self) -> float:
        """Log-odds of the prior, nats."""
        return math.log(self.prior) - math.log1p(-self.prior)


@dataclass(frozen=True)
class StopConfig:
    """When sampling is done; whatever comes first."""

    max_sweeps: int = setting(
        2000, 'largest number of sweeps of each chain', low=1, high=10**9, live=True
    )
    max_time: float = setting(60.0, 'longest time for sampling, s', low=0.01, high=1e7, live=True)
    r_hat: float = setting(
        1.05,
        'a cell has converged when R-hat is below this; 0: do not stop on convergence',
        low=0.0,
        high=10.0,
        live=True,
    )
    agreeing_share: float = setting(
        0.99,
        'stop when this share of the cells with data has converged',
        low=0.0,
        high=1.0,
        live=True,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds or contradicts itself."""
        check_bounds(self)
        possible = self.r_hat == 0.0 or self.r_hat > 1.0
        require(possible, 'r_hat', self.r_hat, 'expected more than 1, or 0 for no such rule')


def check_limits(chain: ChainConfig, stop: StopConfig) -> None:
    """Refuse limits that contradict each other: sampling would end before any sweep counts."""
    require(
        chain.burn_in < stop.max_sweeps,
        'max_sweeps',
        stop.max_sweeps,
        f'expected more than burn_in ({chain.burn_in}), or no sweep counts',
    )


@dataclass(frozen=True)
class PatchConfig:
    """What is known of buildings before any beam ([patch])."""

    prior: str = setting(
        'uniform',
        'prior over maps: uniform: independent cells with chain.prior; patch: frequency of a '
        'patch in training maps; border: its frequency given the cells around it',
        choices=('uniform', 'patch', 'border'),
    )
    size: int = setting(1, 'number of cells in a patch: 1, 9 or 25', low=1, high=25)
    prior_file: str = setting('', 'prior file made by learn-prior; empty: the installed one')
    strength: float = setting(
        1.0,
        'patch, border: power that the learned probabilities are raised to; 1: as counted',
        low=0.1,
        high=10.0,
    )
    min_probability: float = setting(
        0.01,
        'border: patches below this probability are treated as equally likely; the '
        'higher it is, the more specks in sparsely measured space',
        low=0.0,
        high=0.5,
    )
    max_floor: float = setting(
        1.0,
        'patch, border: largest total probability of the patches that are treated as '
        'equally likely; 1: as counted',
        low=1e-12,
        high=1.0,
    )
    order: str = setting(
        'tiled',
        'tiled: patches side by side from a random offset; random: patches at random places, as'
        ' published',
        choices=('tiled', 'random'),
    )
    escape: float = setting(
        0.02,
        'share of the draws of whole patches that also consider patterns missing from the prior',
        low=1e-6,
        high=1.0,
    )
    random_share: float = setting(
        0.0,
        'p_randPatch of the published algorithm, 0.001 there: patches set at random, which does '
        'not leave the posterior as it is; 0: the exact way, `escape`',
        low=0.0,
        high=1.0,
        parameter=False,
    )
    margin: int = setting(
        5,
        'only cells within this many cells of the data are sampled; cells further away stay '
        'occupied, like the unknown cells of the training maps',
        low=1,
        high=10_000,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)
        require(self.size in (1, 9, 25), 'size', self.size, 'one of 1, 9, 25')

    @property
    def single_cells(self) -> bool:
        """Whether this is the sampler of independent cells ([gibbs])."""
        return self.prior == 'uniform' and self.size == 1

    @property
    def window_margin(self) -> int:
        """Cells that the window needs beyond all rays."""
        return 0 if self.single_cells else self.margin


@dataclass(frozen=True)
class SamplerConfig:
    """Everything that decides the samples of a given set of scans.

    By itself it is the sampler of independent cells ([gibbs]); node and command start from
    `nodes.RefineSamplerConfig`.
    """

    model: ForwardModelConfig = ForwardModelConfig()
    window: WindowConfig = WindowConfig()
    chain: ChainConfig = ChainConfig()
    patch: PatchConfig = PatchConfig()

    @property
    def chains_of_cells(self) -> int:
        """How many chains draw single cells, however many rays there are; 0 with patches."""
        return self.chains_for(0) if self.patch.single_cells else 0

    def chains_for(self, n_rays: int) -> int:
        """Return how many chains sample so many rays.

        Between few beams each chain keeps what it once made of the space there, which no reading
        tells: the mean of more chains is nearer to the truth and more alike from run to run, and
        their sweeps are cheap. Many beams leave little open, and more chains only take longer.
        """
        if self.chain.chains:
            return self.chain.chains
        below = () if self.patch.single_cells else CHAINS_BELOW
        return next((chains for most, chains in below if n_rays < most), ENOUGH_CHAINS)


@dataclass(frozen=True)
class ShownConfig:
    """Which cells of a posterior mean are shown as known."""

    unknown_margin: float = setting(
        0.02,
        'a cell is shown as known when max(p, 1 - p) exceeds that of the prior by this, or, of a '
        'wall in the live map, p one half; otherwise it is unknown (-1). Cells without data are '
        'always unknown',
        low=-0.5,
        high=0.5,
        live=True,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)
