"""Placed scans in, a map out: the one page to read first.

    LaserScan --read_scan--> Scan ---------+
                                           +--> engine.placing --> PlacedScan
    Pose... --read_pose--> PoseBelief -----+    (the belief is of the sensor's pose:
    tf, parameters --> SensorMount --------+     the mount is applied here)
                                                      |
                                                      v
    OccupancyGrid <--engine.map_view-- probabilities <-- MappingMethod.update(placed)
                                                           [cast_rays, fuse]

The node `online_mapper`, the commands `map` and `bench`, and the tests all run this page.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, GridMap, PlacedScan
from ogm_mcmc.mapping import (
    Extras,
    add_scans,
    check_change,
    extras_of,
    live_settings,
    make_method,
    uses_covariance,
)

__all__ = ['MappingPipeline']

NOTHING = CellBox(0, 0, 0, 0)


class MappingPipeline:
    """Placed scans in, a map out."""

    def __init__(self, config: MapperConfig) -> None:
        self.config = config
        self.method = make_method(config)
        self.scans_used = 0
        self.changed = NOTHING  # since the start or the last reset

    def update(self, placed: PlacedScan) -> CellBox:
        """Add a scan with the belief about its sensor's pose; return the changed cells.

        Raises GridError, with nothing changed, when the map would become too large.
        """
        changed = self.method.update(placed)
        self.changed = self.changed.union(changed)
        self.scans_used += 1
        return changed

    def update_all(
        self, scans: Sequence[PlacedScan], cancelled: Callable[[], bool] = lambda: False
    ) -> CellBox:
        """Add scans in turn; those that lead too far away are left out. Return the changed cells.

        The same map as of scan after scan, sooner where the method takes them together. Ends
        early when `cancelled`.
        """
        changed, added = add_scans(
            self.config.method, self.method, scans, cancelled, leave_out=True
        )
        self.changed = self.changed.union(changed)
        self.scans_used += added
        return changed

    def configure(self, config: MapperConfig) -> None:
        """Take over settings while mapping.

        Raises ConfigError for a change of one that the method has fixed or does not use.
        """
        check_change(self.config, config)
        if config != self.config:
            self.method.configure(config)
            self.config = config

    def take_over(self, other: MappingPipeline) -> None:
        """Show the map of another pipeline from now on, with the settings that hold here.

        Whoever views the map has to begin anew.
        """
        if other.config != self.config:
            other.configure(self.config)
        self.method, self.scans_used, self.changed = (
            other.method,
            other.scans_used,
            other.changed,
        )

    def reset(self) -> None:
        """Forget the map."""
        self.method.reset()
        self.scans_used = 0
        self.changed = NOTHING

    def map(self) -> GridMap:
        """Return the whole map, cropped to the measured cells."""
        spec = self.method.spec
        return GridMap(spec, self.method.probabilities(spec.box)).cropped()

    def extras(self, box: CellBox) -> Extras:
        """Return what the method saves beside the probabilities of the cells of a box."""
        return extras_of(self.config.method, self.method, box)

    @property
    def uses_covariance(self) -> bool:
        """Whether the method maps with the belief about a pose, not only with its mean."""
        return uses_covariance(self.config.method)

    @staticmethod
    def live_settings(method: str) -> frozenset[str]:
        """Return the dotted names of the settings that a method takes over while it maps."""
        return live_settings(method)
