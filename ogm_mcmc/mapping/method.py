"""What every mapping method offers, and how one is chosen by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Protocol, runtime_checkable

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, GridSpec, PoseBelief, Scan
from ogm_mcmc.mapping.adaptive import AdaptiveMapper
from ogm_mcmc.mapping.counting import CountingMapper
from ogm_mcmc.mapping.pose_uncertain import PoseUncertainMapper
from ogm_mcmc.mapping.random_field import RandomFieldMapper
from ogm_mcmc.mapping.sonar import SonarMapper
from ogm_mcmc.mapping.two_assumption import TwoAssumptionMapper

__all__ = ['METHODS', 'MappingMethod', 'Reconfigurable', 'make_method']


class MappingMethod(Protocol):
    """Update with a scan and a belief over its pose; give the map.

    A method owns its storage. It never changes a cell outside the box that `update` returns, so
    that what is shown can follow with work proportional to the change.
    """

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie at present; grows on its lattice, never moves."""
        ...

    def update(self, scan: Scan, belief: PoseBelief) -> CellBox:
        """Add one scan taken at a believed pose of the sensor; return the cells it may change.

        Raises GridError, with nothing changed, when the map would become too large.
        """
        ...

    def probabilities(self, box: CellBox) -> Float32Array:
        """Probability of being occupied for each cell of a box, nan where never measured."""
        ...

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        ...

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        ...


@runtime_checkable
class Reconfigurable(Protocol):
    """A method that takes over some settings while it maps."""

    live_settings: ClassVar[frozenset[str]]

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; those that are not in `live_settings` are as before."""
        ...


METHODS: dict[str, Callable[[MapperConfig], MappingMethod]] = {
    'two_assumption': TwoAssumptionMapper,
    'pose_uncertain': PoseUncertainMapper,
    'counting': CountingMapper,
    'sonar': SonarMapper,
    'adaptive': AdaptiveMapper,
    'random_field': RandomFieldMapper,
}


def make_method(config: MapperConfig) -> MappingMethod:
    """Make the method a configuration names."""
    return METHODS[config.method](config)
