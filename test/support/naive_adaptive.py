"""The adaptive map from its definition: dictionaries of leaves, exact fractions, no arrays.

Written from [pose] section VI and not from the kernels. A leaf is (level, column, row) and holds
2**level cells a side, cell (c, r) being in it when c >> level and r >> level are those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import Pose2D, Scan
from support.naive import Beam, Cell, beams_of, corner_margin, crossed_cells

__all__ = ['Leaf', 'NaiveAdaptive']

Leaf = tuple[int, int, int]
"""Level, column, row."""

# Upper 5 % points of chi-square with one and two degrees of freedom, from the tables.
CRITICAL = {1: 3.841458820694124, 2: 5.991464547107979}


@dataclass
class _Content:
    log_odds: float | None = None
    hits: float = 0.0
    misses: float = 0.0


@dataclass
class _Seen:
    """What one scan, from all samples, says of a leaf."""

    hits: float = 0.0
    misses: float = 0.0
    unknowns: float = 0.0
    evidence: float = 0.0


@dataclass
class _Sight:
    """One beam: crossed cells, the cell it ends in, the cells behind."""

    crossed: list[Cell]
    end: Cell | None
    behind: list[Cell]


def leaf_of(cell: Cell, level: int) -> Leaf:
    """Node of a level that holds a cell."""
    return level, cell[0] >> level, cell[1] >> level


class NaiveAdaptive:
    """The adaptive map at 5 % significance; `margin` as in `NaiveMapper`."""

    def __init__(self, config: MapperConfig) -> None:
        self.config = config
        self.settings = config.adaptive
        self.leaves: dict[Leaf, _Content] = {}
        self.margin = 1.0

    def leaf(self, cell: Cell) -> Leaf | None:
        """Leaf that holds a cell."""
        for level in range(self.settings.coarsest_level + 1):
            if leaf_of(cell, level) in self.leaves:
                return leaf_of(cell, level)
        return None

    def update(self, scan: Scan, poses: list[tuple[Pose2D, float]]) -> None:
        """Add a scan from weighted poses."""
        sights = [
            ([self._sight(beam, scan, pose) for beam in beams_of(scan, pose, self.config)], weight)
            for pose, weight in poses
        ]
        for beams, _ in sights:
            for sight in beams:
                for cell in [*sight.crossed, *([sight.end] if sight.end else [])]:
                    if self.leaf(cell) is None:
                        root = leaf_of(cell, self.settings.coarsest_level)
                        self.leaves[root] = _Content()
        while True:
            seen = self._look(sights)
            contradicted = [leaf for leaf in seen if self._contradicted(leaf, seen[leaf])]
            if not contradicted:
                break
            for leaf in contradicted:
                inherited = self.leaves.pop(leaf).log_odds
                for child in self._children(leaf):
                    self.leaves[child] = _Content(inherited)
        limit = self.config.log_odds_limit
        for leaf, said in seen.items():
            content = self.leaves[leaf]
            before = content.log_odds
            if before is None:
                before = math.log(self.config.prior / (1.0 - self.config.prior))
            content.log_odds = min(max(before + said.evidence, -limit), limit)
            content.hits += said.hits
            content.misses += said.misses
            total = content.hits + content.misses
            if total > self.settings.count_limit:
                content.hits *= self.settings.count_limit / total
                content.misses *= self.settings.count_limit / total
        self._merge({self._parent(leaf) for leaf in seen})

    def _sight(self, beam: Beam, scan: Scan, pose: Pose2D) -> _Sight:
        crossed = crossed_cells(*beam[:4])
        ends = [abs(value - round(value)) for value in beam[:4]]
        self.margin = min(self.margin, corner_margin(*beam[:4]), *ends)
        if not beam.hit:
            return _Sight(crossed, None, [])
        reach = min(scan.range_max_m, self.config.max_range or math.inf) / self.config.resolution
        length = math.hypot(beam.x1 - beam.x0, beam.y1 - beam.y0)
        share = max(reach / length, 1.0)
        last = beam.x0 + share * (beam.x1 - beam.x0), beam.y0 + share * (beam.y1 - beam.y0)
        behind = beam.x1, beam.y1, *last
        ends = [abs(value - round(value)) for value in last]
        self.margin = min(self.margin, corner_margin(*behind), *ends)
        end = math.floor(beam.x1), math.floor(beam.y1)
        return _Sight(crossed, end, crossed_cells(*behind))

    def _look(self, sights: list[tuple[list[_Sight], float]]) -> dict[Leaf, _Seen]:
        """Hits, misses and unknowns of every leaf that a beam reached, and what they are worth."""
        seen: dict[Leaf, _Seen] = {}
        step = self.config.step
        for beams, weight in sights:
            missed: list[Leaf] = []
            hit: list[Leaf] = []
            for sight in beams:
                end = None if sight.end is None else self.leaf(sight.end)
                before = [cell for cell in sight.crossed if cell != sight.end]
                passed = {leaf for cell in before if (leaf := self.leaf(cell)) not in (end, None)}
                for leaf in passed:
                    assert leaf is not None
                    seen.setdefault(leaf, _Seen()).misses += weight
                    missed.append(leaf)
                if end is not None:
                    said = seen.setdefault(end, _Seen())
                    said.hits += weight
                    if self.settings.way_to_hit:
                        way = sum(self.leaf(cell) == end for cell in before) / 2 ** end[0]
                        said.misses += weight * min(1.0, way)
                    hit.append(end)
            if self.config.fusion == 'per_scan':
                missed, hit = list(set(missed) - set(hit)), list(set(hit))
            for leaf in missed:
                seen[leaf].evidence += weight * step.l_free
            for leaf in hit:
                seen[leaf].evidence += weight * step.l_occ
        if self.settings.unknowns:
            for beams, weight in sights:
                for sight in beams:
                    own = {
                        self.leaf(c) for c in [*sight.crossed, *([sight.end] if sight.end else [])]
                    }
                    for leaf in {self.leaf(cell) for cell in sight.behind} - own:
                        if leaf in seen:
                            seen[leaf].unknowns += weight
        return seen

    def _contradicted(self, leaf: Leaf, said: _Seen) -> bool:
        if leaf[0] <= self.settings.finest_level:
            return False
        content = self.leaves[leaf]
        counts = [content.hits + said.hits, content.misses + said.misses]
        if self.settings.unknowns:
            counts.append(said.unknowns)
        return self._refused(counts)

    def _refused(self, counts: list[float]) -> bool:
        """Whether hits, misses and perhaps unknowns fit neither a free nor an occupied leaf."""
        others = len(counts) - 1
        for right in (0, 1):
            expected = [self.settings.noise / others * sum(counts)] * len(counts)
            expected[right] = (1.0 - self.settings.noise) * sum(counts)
            against = 0.0
            for kind, (seen, usual) in enumerate(zip(counts, expected, strict=True)):
                # Fewer contradictions than usual are none.
                if (seen < usual) == (kind == right):
                    against += (seen - usual) ** 2 / usual
            if against < CRITICAL[others]:
                return False
        return True

    def _children(self, leaf: Leaf) -> list[Leaf]:
        level, column, row = leaf
        return [(level - 1, 2 * column + i, 2 * row + j) for j in (0, 1) for i in (0, 1)]

    def _parent(self, leaf: Leaf) -> Leaf:
        return leaf[0] + 1, leaf[1] >> 1, leaf[2] >> 1

    def _merge(self, parents: set[Leaf]) -> None:
        while parents:
            parent = parents.pop()
            children = self._children(parent)
            if parent[0] > self.settings.coarsest_level:
                continue
            if all(child in self.leaves for child in children) and self._alike(children):
                old = [self.leaves.pop(child) for child in children]
                known = [c.log_odds for c in old if c.log_odds is not None]
                self.leaves[parent] = _Content(
                    sum(known) / 4.0 if known else None,
                    sum(c.hits for c in old),
                    sum(c.misses for c in old),
                )
                parents.add(self._parent(parent))

    def _alike(self, children: list[Leaf]) -> bool:
        log_odds = [self.leaves[child].log_odds for child in children]
        if None in log_odds:
            return log_odds == [None] * 4
        old = [self.leaves[child] for child in children]
        counts = [sum(c.hits for c in old), sum(c.misses for c in old)]
        if sum(counts) > 0.0 and self._refused(counts):
            return False
        p = [1.0 / (1.0 + math.exp(-value)) for value in log_odds if value is not None]
        mean = sum(p) / 4.0
        spread = math.sqrt(sum((value - mean) ** 2 for value in p) / 4.0)
        certain = min(mean, 1.0 - mean) <= self.settings.merge_margin
        return (
            (spread < self.settings.merge_spread and certain)
            or min(p) > self.settings.merge_occupied
            or max(p) < self.settings.merge_free
        )
