"""Of scans that an index has no room for, those that it has."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowFullError
from ogm_mcmc.geometry import PlacedScan

__all__ = ['taken_that_fit']


def taken_that_fit(
    refinement: Refinement,
    take: Callable[[Sequence[PlacedScan]], object],
    scans: Sequence[PlacedScan],
    kept: Recording,
    ended: Callable[[], bool],
) -> Sequence[PlacedScan] | None:
    """Have `take` take as many scans as there is room for; return these, None when `ended()`.

    They are `kept` by what beams were found to be like in the `refinement`: these may err more
    than they did before. Each try builds an index, or begins to. Raises WindowFullError where
    there is no room for one.
    """
    while True:
        try:
            take(scans)
        except WindowFullError:
            found = refinement.beams_found
            fewer = kept.fewer(scans, found.no_return, found.model)
            if len(fewer) == len(scans):
                raise
            if ended():
                return None
            scans = fewer
        else:
            return scans
