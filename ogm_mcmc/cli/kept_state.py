"""What `sample --state` keeps while it samples: hours of work outlast what goes wrong."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import OutputError
from ogm_mcmc.files.output_files import folder_to_fill, makeable_folder, refuse_folder
from ogm_mcmc.files.saying import say

__all__ = ['KeptState']

EVERY_S = 120.0


class KeptState:
    """Writes the chains of a refinement to a file every few minutes, and when it is told to.

    A write that fails is said and tried again later; what was written before stays as it was.
    """

    def __init__(
        self,
        refinement: Refinement,
        path: Path | None,
        every_s: float = EVERY_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.refinement, self.path = refinement, path
        self._every_s, self._clock = every_s, clock
        self._last = clock()

    @staticmethod
    def checked(path: Path) -> None:
        """Raise OutputError where no such file could be written."""
        refuse_folder(path)
        makeable_folder(path.parent)

    def resume(self) -> int:
        """Go on from the file if it is there; return the sweeps that were done before."""
        if self.path is None or not self.path.exists():
            return 0
        self.refinement.resume(self.path)
        assert self.refinement.sampler is not None
        return self.refinement.sampler.sweeps

    def round_done(self) -> None:
        """Write the file if it is time; the chains stand between two sweeps."""
        if self.path is not None and self._clock() - self._last >= self._every_s:
            self.attempt()

    def attempt(self) -> OutputError | None:
        """Write the file now; return, and print, why it could not be written."""
        if self.path is None:
            return None
        self._last = self._clock()
        try:
            with folder_to_fill(self.path.parent):
                self.refinement.save(self.path)
        except OutputError as error:
            say(f'warning: the state is not saved: {error}')
            return error
        return None

    def rescue(self) -> None:
        """Write the file because sampling cannot go on, and say so."""
        if self.path is not None and self.attempt() is None:
            say(f'note: the sweeps done so far are in {self.path}')
