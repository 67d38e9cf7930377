"""What every mapping method offers, and the registration of each by name.

To add a method, write its module, give it settings of its own in `ogm_mcmc.config` (with
`live=True` where a change may take effect while it maps), and register it in `METHODS`, with what
it saves beside the map. Choices of the parameter `method`, live parameters, files and the
documentation follow from that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from ogm_mcmc.arrays import Float32Array, Float64Array
from ogm_mcmc.config import MapperConfig, flatten, settings_of
from ogm_mcmc.errors import ConfigError, GridError, require
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan
from ogm_mcmc.mapping.adaptive import AdaptiveMapper
from ogm_mcmc.mapping.counting import CountingMapper
from ogm_mcmc.mapping.extras import Extras
from ogm_mcmc.mapping.gaussian_field import Prediction
from ogm_mcmc.mapping.log_odds_mapper import NOTHING
from ogm_mcmc.mapping.pose_uncertain import PoseUncertainMapper
from ogm_mcmc.mapping.random_field import RandomFieldMapper
from ogm_mcmc.mapping.sonar import SonarMapper
from ogm_mcmc.mapping.two_assumption import Batch, TwoAssumptionMapper

__all__ = [
    'METHODS',
    'MappingMethod',
    'Registration',
    'all_tables',
    'add_scans',
    'check_change',
    'extras_of',
    'live_settings',
    'make_method',
    'predictor',
    'uses_covariance',
]


class MappingMethod(Protocol):
    """Update with a placed scan; give the map.

    A method owns its storage. It never changes a cell outside the box that `update` returns, so
    that what is shown can follow with work proportional to the change.
    """

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie at present; grows on its lattice, never moves."""
        ...

    def update(self, placed: PlacedScan) -> CellBox:
        """Add one scan with the belief about its sensor's pose; return the cells it may change.

        Raises GridError, with nothing changed, when the map would become too large.
        """
        ...

    def probabilities(self, box: CellBox) -> Float32Array:
        """Probability of being occupied for each cell of a box, nan where never measured."""
        ...

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; the ones that are fixed at start are as before."""
        ...

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        ...

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        ...


BatchUpdate = Callable[[Sequence[PlacedScan], Callable[[], bool]], Batch]


def in_turn(method: Any) -> None:
    """Return nothing: the method takes scans one after the other."""


def no_extras(method: Any, box: CellBox) -> Extras:
    """Return nothing: the method has its probabilities and no more."""
    return Extras()


Predict = Callable[[Any, Float64Array], Prediction]


class Registration(NamedTuple):
    """How a method is made, which settings it uses, and what it saves.

    uses    fields of MapperConfig beside `COMMON`; a nested class stands for all of its settings
    extras  called with the method and the cells that are saved: what it saves beyond the map
    tables  names of the tables in its extras
    at      called with the method and points (N, 2) of the map frame, m: log-odds and variance
            there; None where a method knows of cells alone
    batch   called with the method: what adds many scans at once to the same map as in turn, and
            raises GridError, with nothing changed, when one leads too far away; None: in turn
    """

    make: Callable[[MapperConfig], MappingMethod]
    uses: frozenset[str]
    extras: Callable[[Any, CellBox], Extras] = no_extras
    tables: tuple[str, ...] = ()
    at: Predict | None = None
    batch: Callable[[Any], BatchUpdate | None] = in_turn


COMMON = frozenset({'method', 'resolution', 'max_cells', 'max_range', 'no_return'})

LOG_ODDS = frozenset({'prior', 'log_odds_limit'})
BEAMS = LOG_ODDS | {'inverse_model', 'fusion', 'step', 'gaussian'}

METHODS: dict[str, Registration] = {
    'two_assumption': Registration(
        TwoAssumptionMapper, BEAMS, batch=TwoAssumptionMapper.batch_update
    ),
    'pose_uncertain': Registration(PoseUncertainMapper, BEAMS | {'pose_uncertain'}),
    'adaptive': Registration(
        AdaptiveMapper,
        LOG_ODDS | {'fusion', 'step', 'pose_uncertain', 'adaptive'},
        AdaptiveMapper.extras,
        tables=('tree',),
    ),
    'counting': Registration(CountingMapper, frozenset({'fusion', 'counting'})),
    'random_field': Registration(
        RandomFieldMapper,
        BEAMS | {'random_field'},
        RandomFieldMapper.extras,
        at=RandomFieldMapper.at,
    ),
    'sonar': Registration(SonarMapper, LOG_ODDS | {'sonar'}),
}


def make_method(config: MapperConfig) -> MappingMethod:
    """Make the method a configuration names."""
    return METHODS[config.method].make(config)


def add_scans(
    name: str,
    method: MappingMethod,
    scans: Sequence[PlacedScan],
    cancelled: Callable[[], bool] = lambda: False,
    *,
    leave_out: bool = False,
) -> Batch:
    """Add scans in their order, sooner than one by one where a method takes them together.

    Ends early when `cancelled`. A scan that leads too far away raises GridError; with `leave_out`
    the map is made of the others.
    """
    together = METHODS[name].batch(method)
    if together is not None:
        try:
            return together(scans, cancelled)
        except GridError:  # and nothing was changed
            if not leave_out:
                raise
    changed, added = NOTHING, 0
    for placed in scans:
        if cancelled():
            break
        try:
            changed = changed.union(method.update(placed))
        except GridError:
            if not leave_out:
                raise
        else:
            added += 1
    return Batch(changed, added)


def check_change(before: MapperConfig, after: MapperConfig) -> None:
    """Raise ConfigError for a setting that differs and that the method has fixed or unused."""
    name, old, new = before.method, flatten(before), flatten(after)
    for setting in sorted({one for one in new if new[one] != old[one]} - live_settings(name)):
        require(False, setting, new[setting], f'method {name} has it fixed or unused')


def extras_of(name: str, method: MappingMethod, box: CellBox) -> Extras:
    """Return what a method of this name saves beside the probabilities of the cells of a box."""
    return METHODS[name].extras(method, box)


def predictor(name: str) -> Predict:
    """Return what gives a method's log-odds and variance at any points (N, 2), m.

    Raises ConfigError for a method that knows of cells alone.
    """
    found = METHODS[name].at
    if found is None:
        knows = ' or '.join(sorted(other for other in METHODS if METHODS[other].at))
        raise ConfigError(f'method {name} knows of cells alone: expected {knows} for points')
    return found


def all_tables() -> frozenset[str]:
    """Return the names of the tables of all methods."""
    return frozenset(table for one in METHODS.values() for table in one.tables)


def uses_covariance(method: str) -> bool:
    """Return whether a method maps with the belief about a pose, not only with its mean."""
    return 'pose_uncertain' in METHODS[method].uses


def live_settings(method: str) -> frozenset[str]:
    """Return the dotted names of the settings that a method takes over while it maps."""
    used = COMMON | METHODS[method].uses
    leaves = settings_of(MapperConfig)
    return frozenset(
        leaf.name for leaf in leaves if leaf.live and leaf.name.partition('.')[0] in used
    )
