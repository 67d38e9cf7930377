"""Chains that go on from one order to the next, with what is kept of their maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ogm_mcmc.config import SamplerConfig
from ogm_mcmc.engine.kept_samples import KeptSamples
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.state_file import StateFile
from ogm_mcmc.geometry import PlacedScan

__all__ = ['WarmChains']


class WarmChains:
    """A `Refinement`, the maps kept of it, and how many sweeps its chains did with other scans.

    `shown`: whether a map of them as they are now was handed over; whoever does that says so.
    """

    def __init__(
        self,
        config: SamplerConfig,
        samples: int,
        state: StateFile,
        log: Callable[[str], object],
    ) -> None:
        self.config = config
        self.state = state
        self.kept = KeptSamples(samples)
        self._log = log
        self._said_no_return: tuple[str, str] | None = None  # what was asked, what it came to
        self.begin_anew()

    def begin_anew(self) -> None:
        """Hold no chains; the index may be half grown."""
        self.refinement = Refinement(self.config)
        self._earlier_sweeps = 0
        self.kept.clear()
        self.shown = False

    def forget(self) -> None:
        """Hold no chains, and look at the state file once more."""
        self.begin_anew()
        self.state.forget()

    @property
    def sweeps(self) -> int:
        """How many sweeps these chains did, whatever scans they saw."""
        sampler = self.refinement.sampler
        return self._earlier_sweeps + (0 if sampler is None else sampler.sweeps)

    def take(
        self, scans: Sequence[PlacedScan], *, whole: bool = False, moves: bool = False
    ) -> None:
        """Go on with these scans; with the same ones what was counted stays.

        whole  as `Refinement.take` has it
        moves  scans may soon lie elsewhere: the state file may be of them there

        Raises what `Refinement.take` raises.
        """
        refinement = self.refinement
        if refinement.holds(scans):
            return
        fresh = refinement.sampler is None
        # No name is given to the sampler: its index may have to go before there is another one.
        earlier_sweeps = 0 if refinement.sampler is None else refinement.sampler.sweeps
        self.shown = False
        try:
            refinement.take(scans, whole=whole)
        finally:
            if refinement.sampler is None:  # an error, after the index had changed
                self._earlier_sweeps = 0
        # The share of beams in the text is another one with every scan.
        choice = refinement.beams.no_return
        decided = choice.asked, choice.value
        if str(choice) and decided != self._said_no_return:
            self._log(str(choice))
            self._said_no_return = decided
        self.kept.clear()
        self._earlier_sweeps += earlier_sweeps
        self.state.resume(refinement, scans, whole=whole, fresh=fresh, again=moves)
