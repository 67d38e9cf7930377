"""What a worker does with an order: scans are taken and sampled, and maps handed over."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from ogm_mcmc.engine.handing_over import figures_of, map_now
from ogm_mcmc.engine.kept_poses import EstimatedPoses, KeptPoses
from ogm_mcmc.engine.orders import Order, Orders
from ogm_mcmc.engine.poses_beside import PosesBeside
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.engine.refined_map import RefinedMap, WorkerStatus
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.thinning import taken_that_fit
from ogm_mcmc.engine.warm_chains import WarmChains
from ogm_mcmc.errors import OgmError
from ogm_mcmc.geometry import PlacedScan

__all__ = ['OrderRunner']

# There is always time for a round of sampling.
LEAST_S = 0.01

# A run that is replaced after fewer counted sweeps leaves the map of before.
ENOUGH = 16
# Once scans were placed anew the map of before is worse than that of so many sweeps: after a
# correction, which moves walls; at joint poses, which make them sharper.
SOON, SHARPER = 5, 16

# While poses are estimated chains at those given rest from so many counted sweeps on: their map
# changes little by then, and the processor is for the poses.
RESTS_AT = 32
NOT_YET_JOINT = (
    'the map lies at the poses given: joint ones were not there yet; the next ~/refine goes on '
    'with them (max_time: half of it is for poses)'
)
LOOK_S = 0.5  # how often it is said how far poses are meanwhile


class OrderRunner:
    """Carries out one order after the other, with the same chains and poses.

    With joint poses the first map is that at the poses given. Joint ones are estimated beside, for
    half of the time at most; when they are there chains go on at them, and limits of sweeps count
    from there. `status` and `result` are for others to read: each is one reference.
    """

    def __init__(
        self,
        orders: Orders,
        chains: WarmChains,
        poses: KeptPoses,
        beside: PosesBeside,
        *,
        map_every_s: float,
        log: Callable[[str], object],
        warn: Callable[[str], object],
    ) -> None:
        self.map_every_s = map_every_s
        self.status = WorkerStatus()
        self.result: RefinedMap | None = None
        self._orders, self._chains, self._poses, self._beside = orders, chains, poses, beside
        self._log, self._warn = log, warn
        self._handed_over = 0
        self._soon = SOON

    @property
    def _refinement(self) -> Refinement:
        return self._chains.refinement

    def forget(self) -> None:
        """Hold no chains and no poses."""
        self.status = WorkerStatus()
        self._chains.forget()
        self._poses.forget()
        self._beside.forget()

    def run(self, order: Order) -> None:
        """Sample its scans; what cannot be done is said, and harms nothing."""
        try:
            self._sample(order)
        except OgmError as error:
            self._failed(str(error))
        except MemoryError:
            self._chains.begin_anew()
            self.status = self.status._replace(chain_sweeps=0)
            self._failed(f'no memory to sample {len(order.scans)} scans: expected more')

    def _failed(self, text: str) -> None:
        self._warn(f'not refined: {text}')
        # The next window may be chosen by what was found of beams.
        found = self._refinement.beams_found
        status = self.status._replace(stopped='error', error=text)
        status = status._replace(no_return=found.no_return, model=found.model)
        self.status = status._replace(state='idle')

    def _sample(self, order: Order) -> None:
        self.status = WorkerStatus('indexing', len(order.scans), chain_sweeps=self._chains.sweeps)
        cell_m = self._chains.config.window.resolution
        choice = self._poses.choose(order.scans, cell_m, order.settled, order.drifting)
        if choice.joint and order.settled:
            self._beside.want(order.scans, order.drifting)
        self._soon = SOON
        taken = self._take_kept(order, time.monotonic() + order.stop.max_time)
        began = time.monotonic()
        self._beside.begin(0.5 * order.stop.max_time)  # now: the first map is not to wait
        while taken is not None:
            order, progress = taken, self._advance(taken, began)
            taken, over = self._at_poses_found(order, progress, began)
            if over:
                self._end(order, progress)
                return

    def _advance(self, order: Order, began: float) -> Progress:
        """Sample until a limit, for what is left of the time, or until poses want a look."""
        refinement = self._refinement
        assert refinement.sampler is not None
        # Who keeps scans lets the same go.
        kept = order.kept if order.left_out else None
        model = refinement.beams_found.model if kept is None else kept.model
        self.status = self.status._replace(
            state='sampling',
            scans=len(order.scans),
            left_out=order.left_out,
            **figures_of(refinement),
            model=model,
            chain_sweeps=self._chains.sweeps,
        )
        left_s = max(order.stop.max_time - (time.monotonic() - began), LEAST_S)
        next_map_at = time.monotonic()
        for progress in refinement.run(replace(order.stop, max_time=left_s), self._interrupted):
            progress = progress._replace(seconds=time.monotonic() - began)
            self.status = self.status._replace(
                progress=progress,
                chain_sweeps=self._chains.sweeps,
                poses=self._beside.progress,
                poses_of_map=self._poses.said_of_map(self._beside.moves),
            )
            if progress.counted > 0:
                self._chains.kept.add(refinement.sampler)
            if progress.reason:
                break
            if self._beside.found and not self._beside.moves and (found := self._found_poses()):
                self._poses.keep(found)  # with deviations now
            if self._orders.save and not self._beside.moves:
                self.write_state()
            due = time.monotonic() >= next_map_at
            if due and self._hand_over(order, progress, final=False):
                next_map_at = time.monotonic() + self.map_every_s
        if self._beside.awaited and not self._beside.found and not self._orders.cancel:
            self._hand_over(order, progress, final=False)
        return progress

    def _interrupted(self) -> bool:
        sampler, beside = self._refinement.sampler, self._beside
        rests = sampler is not None and sampler.counted >= RESTS_AT
        return bool(self._orders.cancel) or (beside.moves and (beside.found or rests))

    # -- poses that are estimated meanwhile -------------------------------------------------

    def _at_poses_found(
        self, order: Order, progress: Progress, began: float
    ) -> tuple[Order | None, bool]:
        """Take scans where poses put them; return what to go on with, and whether it is over."""
        over = progress.reason != 'cancelled'
        until = began + order.stop.max_time
        while progress.reason != 'time' and (found := self._found_poses(until, over)):
            self._poses.keep(found)
            if not self._refinement.holds(self._poses.placed(order.scans)):
                return self._go_on_at(order, found, began), False
        return order, over or bool(self._orders.cancel) or time.monotonic() >= until

    def _found_poses(self, until: float = 0.0, every: bool = False) -> EstimatedPoses | None:
        """Return poses found; wait for them until then, for `every` one or those that move."""
        beside = self._beside

        def seen() -> bool:
            return beside.found or not beside.awaited or bool(self._orders.cancel)

        while (left_s := until - time.monotonic()) > 0.0 and not seen():
            if not (every or beside.moves):
                break
            self.status = self.status._replace(state='refining poses', poses=beside.progress)
            with self._orders.changed:
                self._orders.changed.wait_for(seen, min(LOOK_S, left_s))
        try:
            return beside.take() if beside.found and not self._orders.cancel else None
        except OgmError as error:
            self._warn(f'poses not estimated: {error}')
            return None

    def _go_on_at(self, order: Order, found: EstimatedPoses, began: float) -> Order | None:
        """Take scans where they are now; return those taken."""
        self._soon = SHARPER
        self.status = self.status._replace(state='indexing', poses=self._beside.progress)
        until = began + order.stop.max_time
        try:
            taken = self._take_kept(order, until)
        except OgmError as error:  # the map at those given goes on
            self._warn(f'joint poses not used: {error}')
            self._poses.let_go()
            self._beside.end()
            return self._take_kept(order, until)
        if taken is not None:
            self._log(found.said_of(time.monotonic() - began))
            for line in found.said:
                self._log(line)
        return taken

    def _take_kept(self, order: Order, until: float) -> Order | None:
        """Take the scans where they lie now, or those of them that an index has room for.

        Returns the order of these; None where it was ended before there was room.
        """
        scans, kept = order.scans, order.kept
        placed: Sequence[PlacedScan] = self._poses.placed(scans)
        given = {id(one): of for one, of in zip(placed, scans, strict=True)}
        if kept is None:
            self._chains.take(placed, moves=self._beside.moves)
            return order

        def ended() -> bool:
            return bool(self._orders.cancel) or time.monotonic() >= until

        take = partial(self._chains.take, whole=True, moves=self._beside.moves)
        taken = taken_that_fit(self._refinement, take, placed, kept, ended)
        if taken is None:
            reason = self._orders.cancel or 'time'
            self._log(f'ended while scans were chosen that an index has room for ({reason})')
            self.status = self.status._replace(state='idle', stopped=reason)
            return None
        left_out = order.left_out + len(scans) - len(taken)
        if len(taken) < len(scans):
            asked = len(taken) + left_out
            self._warn(f'{len(taken)} of {asked} scans sampled: window.max_memory_mb is too small')
        return order._replace(scans=[given[id(one)] for one in taken], left_out=left_out)

    def _end(self, order: Order, progress: Progress) -> None:
        reason = (
            (self._orders.cancel or 'time') if progress.reason == 'cancelled' else progress.reason
        )
        replaced = reason == 'refined again'
        if not replaced or progress.counted >= ENOUGH or self.result is None:
            self._hand_over(order, progress, final=not replaced)
        # Chains that would not go on at other poses leave the file to those that did.
        if reason not in ('cleared', 'refined again') and not self._beside.moves:
            self.write_state()
        if reason not in ('refined again', 'cleared', 'shut down'):
            self._log(f'{progress.said(len(order.scans))} ({reason})')
            if self._poses.joint and self._poses.trajectory is None:
                self._log(NOT_YET_JOINT)
        status = self.status._replace(poses=self._beside.progress, stopped=reason)
        lies = self._poses.said_of_map(self._beside.moves)
        self.status = status._replace(state='idle', poses_of_map=lies)

    def _hand_over(self, order: Order, progress: Progress, *, final: bool) -> bool:
        """Hand over the map as it is; return whether it is better than that of before."""
        wrong = self._refinement.corrected and progress.sweeps >= self._soon
        if progress.counted == 0 and self.result is not None and not (wrong or self._chains.shown):
            return False  # a map from before is better than the first sweeps of new chains
        result = map_now(
            self._refinement,
            self._chains.kept,
            order.scans,
            self._poses.trajectory,
            number=self._handed_over + 1,
            final=final,
        )
        with self._orders.changed:
            if self._orders.forget:
                return False
            self._handed_over, self.result = result.number, result
            self._chains.shown = True
        return True

    def write_state(self) -> None:
        """Write the state file."""
        self._orders.save = False
        self._chains.state.write(self._refinement)
