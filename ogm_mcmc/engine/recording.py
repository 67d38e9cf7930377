"""The placed scans that are kept for sampling.

What comes in and what goes is counted by reason in `let_go`: evidence is never dropped silently.

A scan is cast when it comes, for the memory its window would need, and again when it is indexed.
Decision: its rays are not held in between. That would take 28 bytes a ray for as long as the
scan is kept, a tenth more than the index, to save 0.23 ms a scan of 180 beams: of Intel 0.2 s in
all when the scans come, beside 0.9 s for the index (5 cm, CPU time, on a busy machine).
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from ogm_mcmc.config import ForwardModelConfig, RecordingConfig, SamplerConfig
from ogm_mcmc.engine.beams_found import alike
from ogm_mcmc.engine.coverage import Coverage
from ogm_mcmc.engine.measured_scans import MeasuredScan, box_around, measuring, on_border
from ogm_mcmc.engine.no_returns import NoReturnChoice
from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.engine.strays import around_most, too_far_apart
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, Scan, wrap_angle
from ogm_mcmc.sampling import RayWindow, WindowSize

__all__ = ['LET_GO', 'Recording']

NS_PER_S = 1_000_000_000

NOTHING = WindowSize(0, 0, CellBox(0, 0, 0, 0))

LET_GO = {
    'older': 'the window was full and they were the oldest',
    'too_old': 'they were older than max_seconds',
    'too_near': 'the sensor had hardly moved, see minimum_travel_distance',
    'thinned': 'the window was full and others covered their place and heading',
    'covered': 'others covered their place and heading when they came',
    'astray': 'most others are so far away that no map would hold all',
    'renewed': 'newer ones of another visit took their place',
}

THINNED_TO = 0.9
"""So much of a full window stays, that not every scan drives out another."""

ROOMY = 0.5
"""With less than this left of what was there when the window was full there is room again."""


class Recording:
    """Placed scans within limits; which go first is up to `window.keep`.

    With a `sampler` scans go that no map could hold with the others, and, if it is `bounded`, the
    memory that its window would need is a limit like the others; with `most_bytes` that of the
    scans themselves. `let_go` counts scans by the reasons of `LET_GO`.
    """

    def __init__(
        self,
        config: RecordingConfig,
        sampler: SamplerConfig | None = None,
        *,
        most_bytes: float = math.inf,
        bounded: bool = True,
    ) -> None:
        self.config = config
        self.bounded = bounded
        self.most_bytes = most_bytes
        self.n_rays = 0  # beams, whether they say anything or not
        self.n_bytes = 0  # of the scans and beliefs
        self.size = NOTHING  # of the window of these scans
        self.let_go: Counter[str] = Counter()
        self.coverage = Coverage()
        self._full_at = 0  # so many scans there were when the window was full
        self._window: RayWindow | None = None
        if sampler is not None:
            # With auto, beams without a return may come to count: so they do for the limits.
            asked = sampler.window.no_return
            self._window = measuring(sampler, 'clear' if asked == 'auto' else asked)
        self._sampler = sampler  # with the model of the beams that was found last
        self._no_return = '' if self._window is None else self._window.config.no_return
        self._unmeasured: tuple[str, ForwardModelConfig] | None = None  # what scans cannot be by
        self._scans: deque[MeasuredScan] = deque()
        self._last: Recent[Pose2D] = Recent()  # where each sensor was when its last scan came in

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self._scans)

    @property
    def model(self) -> ForwardModelConfig | None:
        """What beams are like that memory is counted for, None without a sampler."""
        return None if self._sampler is None else self._sampler.model

    def understand(
        self, no_return: NoReturnChoice | None, model: ForwardModelConfig | None = None
    ) -> None:
        """Count rays as they are indexed, where a sampler found what no return means; None: not.

        Beams that it ignores need no memory. Where it was not sure they may come to count. Beams
        that err more, as a `model` that was found says, are likely along more cells. Scans beyond
        the limits by that go at once.
        """
        if self._sampler is None:
            return
        value, before = self._no_return, self._sampler.model
        if no_return is not None:
            sure = no_return.asked != 'auto' or no_return.found.doubtful
            value = no_return.value if sure else 'clear'
        found = before if model is None or alike(model, before) else model
        if (value, found) in ((self._no_return, before), self._unmeasured):
            return
        sampler = replace(self._sampler, model=found)
        window = measuring(sampler, value)
        try:
            sizes = [window.size_of(old.placement) for old in self._scans]
        except GridError:  # all stays: who samples them so is told why that cannot be
            self._unmeasured = value, found
            return
        self._no_return, self._sampler, self._window = value, sampler, window
        self._keep([o._replace(size=n) for o, n in zip(self._scans, sizes, strict=True)], '')
        self._obey_limits()

    def configure(self, config: RecordingConfig) -> None:
        """Take over other limits; what they let go goes when the next scan comes."""
        if config != self.config:
            self.config = config
            self.coverage.forget()

    def add(self, placement: PlacedScan) -> None:
        """Keep a scan with the belief about its sensor's pose, unless it adds too little.

        Raises GridError, with nothing changed, when no window can hold it together with the scan
        before it, or no map with most of the others: a pose gone astray does not drive these out.
        """
        covering = self.config.window.keep == 'coverage'
        full = covering and self.coverage.is_full(placement)
        if self._is_near_last(placement):
            self.let_go['too_near'] += 1
            return
        if full and not self.coverage.is_visit(placement):
            self.let_go['covered'] += 1
            return
        new = MeasuredScan(placement, self._size_of(placement))
        before = self._scans[-1].size if self._scans else NOTHING
        self._refuse_stray(before.with_more(new.size))
        self._let_strays_go(new)
        if full:
            self._renew(placement)
        self._scans.append(new)
        self._note_last(placement)
        self.n_rays += new.beams
        self.n_bytes += placement.n_bytes
        self.size = self.size.with_more(new.size)
        self.coverage.add(placement)
        self._let_old_go(placement.scan.stamp_ns)
        self._obey_limits()

    def _is_near_last(self, placement: PlacedScan) -> bool:
        window = self.config.window
        last = self._last.get(placement.scan.frame_id)
        if last is None or window.minimum_travel_distance == 0.0:
            return False
        here, there = placement.pose, last
        return (
            math.hypot(here.x_m - there.x_m, here.y_m - there.y_m) < window.minimum_travel_distance
            and abs(wrap_angle(here.yaw_rad - there.yaw_rad)) < window.minimum_travel_heading
        )

    def _note_last(self, placement: PlacedScan) -> None:
        self._last[placement.scan.frame_id] = placement.pose

    def _size_of(self, placement: PlacedScan) -> WindowSize:
        if self._window is None:
            return NOTHING
        return self._window.size_of(placement)

    def _refuse_stray(self, size: WindowSize) -> None:
        if self._window is None or size.n_bytes <= self._most_index_bytes:
            return
        raise GridError(
            f'this scan and the one before it need a window of {size.n_bytes / 1e6:.0f} MB: '
            f'expected at most max_memory_mb = {self._most_index_bytes / 1e6:g}'
        )

    @property
    def _most_index_bytes(self) -> float:
        return self._window.most_bytes if self._window and self.bounded else math.inf

    def _let_strays_go(self, new: MeasuredScan) -> None:
        """Make one map hold a scan with the others; raises GridError where it is the stray."""
        far = too_far_apart(self.size.box.union(new.size.box))
        if not far:
            return
        if self.config.window.keep == 'latest':
            before = self._scans[-1].size if self._scans else NOTHING
            far = too_far_apart(before.box.union(new.size.box))
            while not far and too_far_apart(self.size.box.union(new.size.box)):
                self._let_oldest_go('older')
        else:
            kept = around_most([*(one.size.box for one in self._scans), new.size.box])
            if len(self._scans) in kept:
                scans = list(self._scans)
                self._keep([scans[index] for index in kept[:-1]], 'astray')
                return
        if far:
            x, y = new.placement.pose.x_m, new.placement.pose.y_m
            raise GridError(f'at ({x:.1f}, {y:.1f}) m it leads too far from the others: {far}')

    def _obey_limits(self) -> None:
        while len(self._scans) > 1 and self._beyond_limits():
            self._make_room()

    def _beyond_limits(self) -> bool:
        config = self.config
        return (
            len(self._scans) > config.max_scans
            or self.n_rays > config.max_rays
            or self.n_bytes > self.most_bytes
            or (self._window is not None and self.size.n_bytes > self._most_index_bytes)
        )

    # -- what goes --------------------------------------------------------------------------

    def _let_old_go(self, stamp_ns: int) -> None:
        if self.config.max_seconds == 0.0:
            return
        oldest_ns = stamp_ns - round(self.config.max_seconds * NS_PER_S)
        while len(self._scans) > 1 and self._scans[0].placement.scan.stamp_ns < oldest_ns:
            self._let_oldest_go('too_old')
        if len(self._scans) < ROOMY * self._full_at:
            self._full_at = 0
            self.coverage.forget()

    def _let_oldest_go(self, reason: str) -> None:
        self._let_one_go(0, reason)

    def _let_one_go(self, index: int, reason: str) -> None:
        gone = self._scans[index]
        del self._scans[index]
        self.let_go[reason] += 1
        self.n_rays -= gone.beams
        self.n_bytes -= gone.placement.n_bytes
        self.coverage.remove(gone.placement)
        box = self.size.box
        if on_border(gone.size.box, box):
            box = box_around(self._scans)
        self.size = self.size.without(gone.size, box)

    def fewer(
        self,
        scans: Sequence[PlacedScan],
        no_return: NoReturnChoice | None,
        model: ForwardModelConfig | None,
    ) -> list[PlacedScan]:
        """Keep fewer of these scans, those kept wherever they are now; return them.

        For whom the window of what was found, see `understand`, has no room: a tenth goes at
        least, but for a last one.
        """
        self.replace(scans)
        self.understand(no_return, model)
        while len(self) > max(1.0, THINNED_TO * len(scans)):
            self._make_room()
        return self.snapshot()

    def _make_room(self) -> None:
        if self.config.window.keep == 'coverage':
            self._thin()
        else:
            self._let_oldest_go('older')

    def _thin(self) -> None:
        """Make room for a tenth of the window."""
        scans = list(self._scans)
        self._full_at = len(scans)
        placed = [kept.placement for kept in scans]
        chosen = self.coverage.thinned(placed, int(THINNED_TO * len(scans)))
        self._keep([scans[index] for index in chosen], 'thinned')

    def _renew(self, placement: PlacedScan) -> None:
        """Let the oldest scan of a place and heading go."""
        cell = self.coverage.cell_of(placement)
        for index, kept in enumerate(self._scans):
            if self.coverage.cell_of(kept.placement) == cell:
                self._let_one_go(index, 'renewed')
                return

    def _keep(self, scans: Sequence[MeasuredScan], reason: str) -> None:
        if gone := len(self._scans) - len(scans):
            self.let_go[reason] += gone
        self._scans = deque(scans)
        for kept in scans:
            self._note_last(kept.placement)
        self.n_rays = sum(kept.beams for kept in scans)
        self.n_bytes = sum(kept.placement.n_bytes for kept in scans)
        rays, pairs = sum(k.size.rays for k in scans), sum(k.size.pairs for k in scans)
        near = sum(k.size.near for k in scans)
        zones = sum(k.size.zones for k in scans)
        self.size = WindowSize(rays, pairs, box_around(scans), near, zones)
        self.coverage.count_anew(kept.placement for kept in scans)

    def replace(self, placed: Sequence[PlacedScan]) -> None:
        """Keep the same scans at other poses, in the order of `snapshot`.

        Raises GridError, with nothing changed, when no window can hold them.
        """
        scans = [
            old if old.placement is new else MeasuredScan(new, self._size_of(new))
            for old, new in zip(self._scans, placed, strict=True)
        ]
        self._refuse_box(WindowSize(0, 0, box_around(scans)))
        self._keep(scans, 'thinned')
        self._obey_limits()

    def read_anew(self, read: Callable[[Scan], Scan]) -> None:
        """Keep the scans as `read` returns them; one that says the same returns it as it is."""
        scans = []
        for old in self._scans:
            scan = read(old.placement.scan)
            if scan is not old.placement.scan:
                placement = old.placement._replace(scan=scan)
                old = MeasuredScan(placement, self._size_of(placement))
            scans.append(old)
        if any(new is not old for new, old in zip(scans, self._scans, strict=True)):
            self._keep(scans, '')
            self._obey_limits()

    def _refuse_box(self, size: WindowSize) -> None:
        if self._window is None:
            return
        if size.n_bytes > self._most_index_bytes:
            raise GridError(
                f'the scans at these poses need a window of {size.box.n_cells} cells: expected '
                f'what max_memory_mb = {self._most_index_bytes / 1e6:g} can hold'
            )
        if far := too_far_apart(size.box):
            raise GridError(f'the scans at these poses lie too far apart: {far}')

    def snapshot(self) -> list[PlacedScan]:
        """Return the scans as they are now."""
        return [kept.placement for kept in self._scans]

    def copy(self) -> Recording:
        """Return a recording of the same scans, which goes its own way from here."""
        copy = Recording(self.config, most_bytes=self.most_bytes, bounded=self.bounded)
        copy.n_rays, copy.n_bytes, copy.size = self.n_rays, self.n_bytes, self.size
        copy.let_go, copy.coverage = self.let_go.copy(), self.coverage.copy()
        copy._full_at, copy._window = self._full_at, self._window
        copy._sampler, copy._no_return = self._sampler, self._no_return
        copy._scans = self._scans.copy()
        for frame, pose in self._last.items():
            copy._last[frame] = pose
        return copy

    def values(self) -> dict[str, object]:
        """Return what is kept, what went and why, for /diagnostics."""
        coverage, keep = self.coverage, self.config.window.keep
        why = 'all: there is room'
        if keep == 'coverage' and coverage.most is not None:
            share = f'at most {coverage.most} scan{"s"[: coverage.most > 1]} of each place'
            why = f'{share} of {coverage.cell_m:g} m and heading of {coverage.cell_rad:.2g} rad'
        elif keep == 'latest' and self.let_go['older']:
            why = 'the latest'
        beams, model = 'nothing', self.model
        if model is not None:
            beams = f'sigma {model.sigma_m:.3g} m, grazing {model.grazing_m:.3g} m'
        return {
            'scans recorded': len(self),
            'beams recorded': self.n_rays,
            'kept': why,
            'scans let go': self.let_go.total(),
            **{f'let go: {key}': count for key, count in sorted(self.let_go.items())},
            'memory of a window at most (MB)': f'{self.size.n_bytes / 1e6:.1f}',
            'memory of a window is counted for': beams,
        }

    def clear(self) -> None:
        """Forget all scans."""
        self._scans.clear()
        self._last.clear()
        self.let_go.clear()
        self.coverage = Coverage()
        self.n_rays = self.n_bytes = self._full_at = 0
        self.size, self._unmeasured = NOTHING, None
