"""The file that the worker keeps its chains in from one start of the node to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import OgmError, WindowError
from ogm_mcmc.geometry import PlacedScan

__all__ = ['StateFile']


class StateFile:
    """Writes chains and takes them up again; says each reason why it cannot once.

    path  None: nothing is ever written or read
    """

    def __init__(
        self, path: Path | None, log: Callable[[str], object], warn: Callable[[str], object]
    ) -> None:
        self.path = path
        self.unsaved = ''  # why it could not be written, the last time
        self._looked = False
        self._log, self._warn = log, warn

    def resume(
        self,
        refinement: Refinement,
        scans: Sequence[PlacedScan],
        *,
        whole: bool,
        fresh: bool,
        again: bool,
    ) -> None:
        """Go on from the file, if there is one, instead of from chains on scans just taken.

        It is looked at once, until `forget`: later chains know more. With `again` it may be of
        these scans at other poses, so it is looked at once more with the next ones. `fresh` says
        that there were no chains before.
        """
        if self._looked or self.path is None:
            return
        self._looked = not again
        if not self.path.exists():
            return
        try:
            refinement.resume(self.path)
        except WindowError as error:
            if not again:
                goes_on = 'starts new chains' if fresh else 'chains go on as they are'
                self._log(f'{goes_on}: {error}')
            if refinement.sampler is None:
                refinement.take(scans, whole=whole)  # the index had been of what the file says
        else:
            self._looked = True
            self._log(f'continues from {self.path}')

    def forget(self) -> None:
        """Look at the file with the next scans, as in the beginning."""
        self._looked = False

    def write(self, refinement: Refinement) -> None:
        """Write the chains, if there are any."""
        if self.path is None or refinement.sampler is None:
            return
        try:
            refinement.save(self.path)
        except OgmError as error:
            if str(error) != self.unsaved:
                self._warn(f'state not saved: {error}')
            self.unsaved = str(error)
        else:
            if self.unsaved:
                self._log(f'state saved again: {self.path}')
            self.unsaved = ''
