"""Which of the poses a bag holds to use: those that cover its scans, the better kind first.

Coverage decides: the share of scans whose stamp lies between two entries that are not too far
apart. /initialpose, goals and waypoints say something now and then, so they cover next to nothing.
Among sources that cover about as many scans (nine tenths of the best) the order is:

1. poses in the map before odometry, which drifts (`is_called_odom`);
2. poses that come at least twice a second before rarer ones, between which the robot may have
   gone any way;
3. those that say how uncertain they are (PoseWithCovarianceStamped, particles, Odometry) before
   single points (tf, PoseStamped). A PoseArray counts as particles if its topic is called so: it
   may hold anything;
4. tf before single points on a topic, the larger coverage, then the name.

What a topic calls a goal, a target or a click, what is said in the frame of a camera, and what
does not move as the odometry does (`pose_motion`) is no place of the robot, however often it
comes: it is taken where nothing else covers a scan, and only if it covers half of them.

A localizer starts later than the wheels turn: the scans before are worth losing for a map that
does not drift. This is why nine tenths are enough.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Int64Array
from ogm_mcmc.engine.transform_tree import TransformTree

__all__ = [
    'PoseCandidate',
    'PoseChoice',
    'RankedPoses',
    'choose_poses',
    'is_called_odom',
    'tf_candidates',
]

NS_PER_S = 1_000_000_000

TF = 'tf'
FILE = 'trajectory file'

# Sources that cover this share of what the best one covers are as good.
ABOUT_AS_MANY = 0.9

# Clicks and goals alone are taken from this share on: they may be badly named.
HALF = 0.5

# Poses that come less often than this leave open how the robot went.
DENSE_NS = NS_PER_S // 2

# Parts of the names of topics with poses that are not the robot's.
CAMERA = re.compile(r'camera|optical|(^|[/_])(cam|rgb|depth|lens)([/_0-9]|$)')

ELSEWHERE = re.compile(
    r'(^|_)(goal|target|plan|path|way_?point|initial_?pose|clicked|carrot|look_?ahead|setpoint|'
    r'reference|command|cmd|marker|landmark|(april|aruco)?_?tag|aruco|detection)(s?)(_|$)'
)

UNCERTAIN = ('PoseWithCovarianceStamped', 'ParticleCloud', 'Odometry')


class PoseCandidate(NamedTuple):
    """One source of poses: what it is called and when it says something.

    `kind`: a message type, `tf` or `trajectory file`. `frame`, `child_frame`: between which
    frames (the child may be empty). `stamps` (N,) ns of its entries, in any order; of tf one
    array for each edge that moves. `elsewhere`: known not to be those of the robot. `unstamped`:
    its messages say nothing of when, `stamps` are the times at which they were recorded.
    """

    name: str
    kind: str
    frame: str
    child_frame: str
    stamps: tuple[Int64Array, ...]
    elsewhere: bool = False
    unstamped: bool = False


class RankedPoses(NamedTuple):
    """A candidate and which share of the scans it covers."""

    candidate: PoseCandidate
    coverage: float

    def __str__(self) -> str:
        """Return `/odom 98 %`, or the frames for tf."""
        return f'{self._name} {self._percent}'

    @property
    def _name(self) -> str:
        source = self.candidate
        frames = f' {source.frame} -> {source.child_frame}' if source.kind == TF else ''
        return source.name + frames

    @property
    def _percent(self) -> str:
        # 100 % stands for all, 0 % for none.
        percent = 100.0 * self.coverage
        if 0.0 < percent < 1.0:
            return 'under 1 %'
        return f'{int(percent)} %'

    def described(self, n_scans: int) -> str:
        """Return `/odom (nav_msgs/msg/Odometry, 100 % of 910 scans)`."""
        kind = '' if self.candidate.kind == TF else f'{self.candidate.kind}, '
        return f'{self._name} ({kind}{self._percent} of {n_scans} scans)'


class PoseChoice(NamedTuple):
    """What to use (None where nothing covers a single scan), and the rest, the best first."""

    chosen: RankedPoses | None
    others: tuple[RankedPoses, ...]
    scan_stamps: Int64Array
    max_gap_s: float = 2.0

    def odometry(self) -> PoseCandidate | None:
        """Return what else tells how far the robot went: Odometry or tf, about as many scans."""
        if self.chosen is None:
            return None
        enough = ABOUT_AS_MANY * self.chosen.coverage
        return next(
            (
                one.candidate
                for one in self.others
                if one.coverage >= enough
                and (one.candidate.kind == TF or one.candidate.kind.endswith('Odometry'))
            ),
            None,
        )

    def rarely(self) -> str:
        """Return a warning where the poses chosen come so rarely that the way is unknown."""
        if self.chosen is None or self.chosen.candidate.kind in (TF, FILE):
            return ''
        source = self.chosen.candidate
        usual_ns = _typical_gap(source.stamps[0])
        own = np.isin(self.scan_stamps, source.stamps[0]).mean()
        if usual_ns <= DENSE_NS or own >= ABOUT_AS_MANY:  # nothing to interpolate
            return ''
        there = any(one.candidate.kind == TF and one.coverage > 0.0 for one in self.others)
        better = 'better poses: --pose-source tf' if there else 'tf knows better: record /tf, too'
        often = f'every {usual_ns / NS_PER_S:.1f} s' if usual_ns < float('inf') else 'once'
        return (
            f'poses on {source.name} come {often}: between them the robot is taken to go straight,'
            f' and scans in gaps of more than {self.max_gap_s:g} s (max_pose_gap) are left out; '
            + better
        )

    def __str__(self) -> str:
        """Return one line for the user."""
        if self.chosen is None:
            return self._refusal()
        line = f'poses from {self.chosen.described(self.scan_stamps.size)}'
        if self.others:
            line += f'; also there: {", ".join(map(str, self.others))}'
        return line

    def _refusal(self) -> str:
        if not self.others:
            return 'no poses in it: expected a topic with poses or tf'
        if not self.scan_stamps.size:
            return 'no scans in it that poses could cover'
        spans = [f'{ranked._name} {_span(ranked.candidate.stamps)}' for ranked in self.others]
        return (
            f'no poses at the stamps of the scans ({_span((self.scan_stamps,))}) that are at most '
            f'{self.max_gap_s:g} s apart (max_pose_gap): there are {", ".join(spans)}'
        )


def choose_poses(
    candidates: Sequence[PoseCandidate],
    scan_stamps: Int64Array,
    *,
    max_gap_s: float = 2.0,
    unwanted: Sequence[PoseCandidate] = (),
    any_place: bool = False,
) -> PoseChoice:
    """Rank sources of poses for scans at the given stamps (S,) ns; see the module's text.

    Those unwanted are named among the others only. With `any_place` what is no place of the robot
    is taken as well, however few scans it covers: the user named it.
    """
    stamps = np.sort(scan_stamps)
    max_gap_ns = round(max_gap_s * NS_PER_S)
    ranked = [RankedPoses(one, coverage(one.stamps, stamps, max_gap_ns)) for one in candidates]
    # What is elsewhere does not say how many scans could be covered.
    usual = [one.coverage for one in ranked if not _elsewhere(one.candidate)]
    best = max(usual, default=0.0) or max((one.coverage for one in ranked), default=0.0)
    ranked.sort(key=lambda one: _rank(one, best))
    if unwanted:
        beside = choose_poses(unwanted, stamps, max_gap_s=max_gap_s)
        more = (() if beside.chosen is None else (beside.chosen,)) + beside.others
    else:
        more = ()
    clicks = not any_place and bool(ranked) and _elsewhere(ranked[0].candidate)
    if best == 0.0 or (clicks and ranked[0].coverage < HALF):
        return PoseChoice(None, (*ranked, *more), stamps, max_gap_s)
    return PoseChoice(ranked[0], (*ranked[1:], *more), stamps, max_gap_s)


def is_called_odom(frame: str) -> bool:
    """Return whether a frame is that of odometry by its name: `odom` is in it, after any slash."""
    return 'odom' in frame.rsplit('/')[-1].lower()


def coverage(edges: Sequence[Int64Array], scan_stamps: Int64Array, max_gap_ns: int) -> float:
    """Return the share of scans whose stamp every edge covers: at an entry, or in a small gap."""
    covered = np.ones(scan_stamps.size, bool)
    for edge in edges:
        covered &= _covered(np.sort(edge), scan_stamps, max_gap_ns)
    return float(covered.mean()) if covered.size else 0.0


def _covered(known: Int64Array, wanted: Int64Array, max_gap_ns: int) -> BoolArray:
    if not known.size:
        return np.zeros(wanted.size, bool)
    later = np.searchsorted(known, wanted, side='left')
    earlier = np.searchsorted(known, wanted, side='right') - 1
    inside = (earlier >= 0) & (later < known.size)
    last = known.size - 1
    apart = known[np.minimum(later, last)] - known[np.maximum(earlier, 0)]
    # At the very stamp of an entry `later` is at or before `earlier`.
    covered: BoolArray = inside & (apart <= max_gap_ns)
    return covered


def _rank(ranked: RankedPoses, best: float) -> tuple[object, ...]:
    source = ranked.candidate
    enough = ranked.coverage >= ABOUT_AS_MANY * best and ranked.coverage > 0.0
    drifts = is_called_odom(source.frame)
    typical_ns = max((_typical_gap(edge) for edge in source.stamps), default=0.0)
    return (
        ranked.coverage == 0.0,
        _elsewhere(source),
        not enough,
        (drifts, typical_ns > DENSE_NS, not _uncertain(source)) if enough else (),
        source.kind != TF,
        -ranked.coverage,
        source.name,
        source.frame != 'map',
        source.frame,
    )


def _elsewhere(source: PoseCandidate) -> bool:
    if source.kind in (TF, FILE):
        return False
    words = source.name.lower().strip('/').split('/')
    # Of single poses the namespace tells as well: /apriltag/pose, /planner/plan/pose.
    told = words[-1:] if source.kind.endswith(UNCERTAIN) else words
    seen = CAMERA.search(source.frame.lower()) is not None
    return source.elsewhere or seen or any(ELSEWHERE.search(word) for word in told)


def _typical_gap(stamps: Int64Array) -> float:
    return float(np.median(np.diff(np.sort(stamps)))) if stamps.size > 1 else float('inf')


def _uncertain(source: PoseCandidate) -> bool:
    if source.kind.endswith('PoseArray'):
        return 'particle' in source.name.lower()
    return source.kind.endswith(UNCERTAIN)


def _span(edges: Sequence[Int64Array]) -> str:
    filled = [edge for edge in edges if edge.size]
    if not filled:
        return 'never' if edges else 'always'
    first = max(int(edge.min()) for edge in filled)
    last = min(int(edge.max()) for edge in filled)
    return f'{first / 1e9:.1f} to {last / 1e9:.1f} s'


def tf_candidates(tree: TransformTree, base_frame: str) -> list[PoseCandidate]:
    """Return the poses of the base in every frame above it, and in that of odometry below."""
    found = []
    above = tree.ancestors(base_frame)[1:]
    # KISS-ICP may send its odometry the other way round: from the base down to odom_lidar.
    below = [
        frame
        for frame in tree.frames()
        if tree.ancestors(frame)[1:2] == [base_frame]
        and frame.rsplit('/')[-1].startswith(('odom', 'map'))
    ]
    for frame in above + below:
        stamps = tree.moving_stamps(frame, base_frame)
        if stamps:
            found.append(PoseCandidate(TF, TF, frame, base_frame, tuple(stamps)))
    return found
