"""Whether beams without a return may clear: how many of them cross what other beams hit.

A beam without a return says that there is nothing up to range_max (REP 117), or that its light
came back too weak: from glass, dark or distant walls. The recording tells which: in the first case
such beams go where nothing is, in the second straight through walls that other beams see.

`no_return: auto` goes by that, and takes ignore where too few beams tell: what is cleared wrongly
is lost, and what is not cleared waits for the next beam. A recording is looked at first
(`no_return_of`). A live map cannot look ahead: it begins with ignore (`LiveNoReturn`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.geometry import PlacedScan

__all__ = ['LiveNoReturn', 'NoReturnChoice', 'NoReturnWatch', 'NoReturns', 'no_return_of']

# Scans looked at, spread over all of them, and beams without a return, spread over those.
KEPT = 100
MOST_BEAMS = 1500

# A cell counts as hit when so many beams of other scans ended in it.
HITS = 2

# Above this share such beams are taken to have lost what they met; fewer than so many beams tell
# nothing.
MOST = 0.5
FEWEST_BEAMS = 20

# A live map looks again at the first so many scans, and whenever there are twice as many; then at
# fewer beams, as scans wait meanwhile.
FIRST_LOOK = 25
LIVE_BEAMS = 400

# Where they clear because the user says so, a look is for a warning only: so seldom.
CLEAR_LOOK, CLEAR_LOOK_AGAIN = 100, 10

# At first beams cross little, for little is mapped: 13 % after 25 scans of the Freiburg log, 22 %
# after 50, 52 % after 100. So a live map lets them clear after so many scans in so many squares of
# so many metres, if no more than this share of the beams crosses what others hit (5 to 16 % in
# simulated buildings, where walls are grazed).
SCANS = 100
PLACES = 20
PLACE_M = 0.25
FEW = 0.3

# Cells of this side at least: noise spreads a wall over smaller ones. Beams are followed over so
# many of them.
LEAST_CELL_M = 0.05
MOST_STEPS = 4000

# Cells are named by one number.
ROWS = 2**31


class NoReturns(NamedTuple):
    """Beams without a return that were looked at, and how many of them cross cells hit."""

    beams: int
    crossing: int

    @property
    def share(self) -> float:
        """Share of the beams that cross what others hit; 0 without any."""
        return self.crossing / self.beams if self.beams else 0.0

    @property
    def few(self) -> bool:
        """Whether these are too few to tell."""
        return self.beams < FEWEST_BEAMS

    @property
    def doubtful(self) -> bool:
        """Whether most of them do."""
        return not self.few and self.share > MOST

    @property
    def judged(self) -> str:
        """What +inf means by that."""
        return 'ignore' if self.few or self.doubtful else 'clear'

    def __str__(self) -> str:
        """Return what was seen, for the user."""
        if self.few:
            return f'too few beams without a return to tell ({self.beams})'
        return f'{self.share:.0%} of the beams without a return cross cells that other beams hit'


class NoReturnChoice(NamedTuple):
    """What +inf means here, `clear` or `ignore`; what was asked for, and what beams tell."""

    value: str
    asked: str
    found: NoReturns

    @classmethod
    def of(cls, asked: str, found: NoReturns) -> NoReturnChoice:
        """Decide where `auto` is asked for."""
        return cls(found.judged if asked == 'auto' else asked, asked, found)

    @classmethod
    def of_cones(cls, asked: str) -> NoReturnChoice:
        """Decide for sonars: their cones are not told apart by what they cross, and clear."""
        return cls('clear' if asked == 'auto' else asked, asked, NoReturns(0, 0))

    def __str__(self) -> str:
        """Return one line for the user; empty where there is nothing to say."""
        if self.asked == 'auto' and self.found.beams > 0:
            other = 'clear' if self.value == 'ignore' else 'ignore'
            if self.value != self.found.judged:
                return (
                    f'no_return auto: {self.value} was chosen from the first scans, but over all '
                    f'scans {self.found}: set no_return: {other}'
                )
            return f'no_return auto: {self.value}, {self.found} (or say no_return: {other})'
        if self.value == 'clear' and self.found.doubtful:
            return f'{self.found}: they clear walls; no_return: ignore keeps those'
        return ''

    def as_dict(self) -> dict[str, object]:
        """Return plain values for JSON."""
        found = self.found
        return {'value': self.value, 'beams': found.beams, 'crossing': round(found.share, 3)}


class NoReturnWatch:
    """Sees scans go by, keeps some, and judges when asked; `reach_m` bounds beams, 0 does not."""

    def __init__(
        self, resolution_m: float, reach_m: float = 0.0, most_beams: int = MOST_BEAMS
    ) -> None:
        self.resolution_m = max(resolution_m, LEAST_CELL_M)
        self.reach_m = reach_m
        self.most_beams = most_beams
        self._kept: list[PlacedScan] = []
        self._every = 1
        self.seen = 0

    def see(self, placed: PlacedScan) -> None:
        """Take note of a scan."""
        if self.seen % self._every == 0:
            # Of a belief only its mean is of use, and a cloud of particles is large.
            self._kept.append(PlacedScan.at(placed.scan, placed.pose))
            if len(self._kept) >= 2 * KEPT:
                del self._kept[1::2]
                self._every *= 2
        self.seen += 1

    def places(self) -> int:
        """Return in how many squares of `PLACE_M` the sensors were."""
        squares = {
            (math.floor(one.pose.x_m / PLACE_M), math.floor(one.pose.y_m / PLACE_M))
            for one in self._kept
        }
        return len(squares)

    def judge(self) -> NoReturns:
        """Return what the scans kept say."""
        hit = [self._hit_cells(placed) for placed in self._kept]
        every = np.concatenate([np.zeros(0, np.int64), *hit])
        cells, counts = np.unique(every, return_counts=True)
        beams = crossing = 0
        for own, placed in zip(hit, self._kept, strict=True):
            crossed = self._crossed_cells(placed)
            if not (crossed.size and cells.size):
                beams += crossed.shape[0]
                continue
            by_others = counts.copy()
            by_others[np.searchsorted(cells, own)] -= 1
            at = np.minimum(np.searchsorted(cells, crossed), cells.size - 1)
            met = (cells[at] == crossed) & (by_others[at] >= HITS)
            beams += crossed.shape[0]
            crossing += int(met.any(axis=1).sum())
        return NoReturns(beams, crossing)

    def _hit_cells(self, placed: PlacedScan) -> Int64Array:
        ranges = placed.scan.ranges_m.astype(np.float64)
        hit = placed.scan.measured() & (ranges <= MOST_STEPS * self.resolution_m)
        ends = placed.along(hit, ranges[hit])
        return np.unique(self._names(ends))

    def _crossed_cells(self, placed: PlacedScan) -> Int64Array:
        """Return the cells along some beams without a return, a row for each."""
        scan = placed.scan
        reach = scan.range_max_m if self.reach_m == 0.0 else min(scan.range_max_m, self.reach_m)
        missing = np.flatnonzero(scan.ranges_m == np.inf)
        if not missing.size or not math.isfinite(reach):
            return np.zeros((0, 1), np.int64)
        most = max(1, self.most_beams // len(self._kept))
        some = missing[:: -(-missing.size // most)]
        steps = min(reach / self.resolution_m, MOST_STEPS)
        along = np.arange(1.0, steps) * self.resolution_m
        return self._names(placed.along(some[:, None], along))

    def _names(self, points: Float64Array) -> Int64Array:
        column, row = np.floor(points / self.resolution_m).astype(np.int64)
        return np.asarray(column * ROWS + row, np.int64)


def no_return_of(
    asked: str, scans: Iterable[PlacedScan], resolution_m: float, reach_m: float = 0.0
) -> NoReturnChoice:
    """Return what +inf means in these scans."""
    watch = NoReturnWatch(resolution_m, reach_m)
    for placed in scans:
        watch.see(placed)
    return NoReturnChoice.of(asked, watch.judge())


class LiveNoReturn:
    """What +inf means in a map that grows; `choice` is what holds now."""

    def __init__(self, asked: str, resolution_m: float, reach_m: float = 0.0) -> None:
        self._watch = NoReturnWatch(resolution_m, reach_m, LIVE_BEAMS)
        self._next_look = CLEAR_LOOK if asked == 'clear' else FIRST_LOOK
        self._told: tuple[object, ...] = ()
        self.choice = NoReturnChoice.of(asked, NoReturns(0, 0))

    def see(self, placed: PlacedScan) -> str:
        """Take note of a scan that was mapped; return what to say now, empty: nothing new."""
        self._watch.see(placed)
        asked = self.choice.asked
        if self._watch.seen < self._next_look or asked == 'ignore':
            return ''
        self._next_look = (CLEAR_LOOK_AGAIN if asked == 'clear' else 2) * self._watch.seen
        found, before = self._watch.judge(), self.choice
        self.choice = NoReturnChoice.of(before.asked, found)
        if self.choice.value != before.value == 'ignore' and not self._sure(found):
            self.choice = self.choice._replace(value='ignore')
            return ''  # it waits for more
        told = (self.choice.asked, self.choice.value, found.doubtful)
        new = not found.few and told != self._told
        self._told = told if new else self._told
        return str(self.choice) if new else ''

    def text(self) -> str:
        """Return what holds, for diagnostics."""
        value, asked, found = self.choice
        why = '' if found.beams == 0 else f': {found}'
        if asked != 'auto':
            return f'{value}{why}'
        waits = ' for now' if value != found.judged or found.few else ''
        return f'{value}{waits} (auto){why}'

    def _sure(self, found: NoReturns) -> bool:
        """Whether the robot has seen enough to let beams clear."""
        return (
            not found.few
            and found.share <= FEW
            and self._watch.seen >= SCANS
            and self._watch.places() >= PLACES
        )

    def ask(self, asked: str, reach_m: float) -> None:
        """Take over other settings."""
        self._watch.reach_m = reach_m
        if asked != self.choice.asked:
            self.choice = NoReturnChoice.of(asked, NoReturns(0, 0))
            self._next_look = self._watch.seen + 1

    def see_anew(self, scans: Iterable[PlacedScan]) -> None:
        """Forget the scans that were seen for these, at other poses; look again with the next."""
        self._watch = NoReturnWatch(self._watch.resolution_m, self._watch.reach_m, LIVE_BEAMS)
        for placed in scans:
            self._watch.see(placed)
        self._next_look = min(self._next_look, max(FIRST_LOOK, self._watch.seen + 1))
