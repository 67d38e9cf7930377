"""What poses hold for which scans, until they are forgotten.

A scan whose pose was estimated lies there. One that came since lies where the localizer has it,
with the correction of the scan next to it in time: beside scans that moved it would double walls.
Where any scan was placed anew, as by a corrected trajectory, what was estimated of it and of its
neighbours no longer holds, and all lie as given until they are estimated anew.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ogm_mcmc.config import PosesConfig
from ogm_mcmc.engine.joint_poses import PosesChoice, RefinedTrajectory, choose_joint
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.trajectory.points import wrapped, xyyaw

__all__ = ['WAITS', 'EstimatedPoses', 'KeptPoses']

WAITS = (
    'poses as given while a trajectory moves recorded scans: joint ones are estimated when it has '
    'moved none for a while, or with the next ~/refine after that'
)


class EstimatedPoses(NamedTuple):
    """Scans as they were `given`, `placed` where they are now, in the same order.

    `aligned`: later ones differ in covariances alone. `said`: lines for the log about what was
    found by the way.
    """

    given: Sequence[PlacedScan]
    placed: list[PlacedScan]
    trajectory: RefinedTrajectory
    aligned: bool
    said: tuple[str, ...] = ()

    def said_of(self, seconds: float) -> str:
        """Return a line for the log: after how long they are used, and how far scans moved."""
        moved = wrapped(
            xyyaw([one.pose for one in self.placed]) - xyyaw([one.pose for one in self.given])
        )
        x, y, turn = (moved**2).mean(axis=0)
        return (
            f'poses joint after {seconds:.1f} s: {len(self.given)} scans moved by '
            f'{100.0 * math.sqrt(x + y):.1f} cm and {math.degrees(math.sqrt(turn)):.2f} degrees '
            '(root mean squares); sampling goes on there'
        )


class _Held(NamedTuple):
    given: PlacedScan
    placed: PlacedScan


class KeptPoses:
    """Poses of scans as they were estimated last, and whether they are to be."""

    def __init__(
        self, config: PosesConfig, log: Callable[[str], object] = lambda text: None
    ) -> None:
        self.config = config
        self._log = log
        self._said: bool | None = None
        self._waits = False  # joint poses, until those given are settled
        self.joint: bool | None = None  # as chosen last
        self.trajectory: RefinedTrajectory | None = None
        # By belief: a scan that was read anew, with the belief it had, is where it was.
        self._held: dict[int, _Held] = {}
        self._corrections: list[tuple[int, Pose2D]] = []  # by stamp, ns: map as given to map now

    def choose(
        self,
        scans: Sequence[PlacedScan],
        resolution_m: float,
        settled: bool = True,
        drifting: bool = False,
    ) -> PosesChoice:
        """Decide whether poses of scans are estimated: as before, unless that is clearly wrong.

        Where they are not, no poses of before are left; where they are, those of these scans.
        Why is logged, where that is another choice than was said last; so is that joint poses
        have to wait, where those given are not `settled`.
        """
        choice = choose_joint(scans, self.config, resolution_m, self.joint, drifting)
        if not choice.joint:
            self.let_go()
        asked = set(map(_stamp, scans))
        self._held = {key: one for key, one in self._held.items() if _stamp(one.given) in asked}
        if choice.why and choice.joint != self._said:
            self._log(choice.why)
            self._said = choice.joint
        self.joint = choice.joint
        waits = choice.joint and not settled
        if waits and not self._waits:
            self._log(WAITS)
        self._waits = waits
        return choice

    def said_of_map(self, moves: bool) -> str:
        """Return at which poses maps are; `moves`: others are being estimated."""
        here = 'as given' if not self.joint or self.trajectory is None else 'joint'
        if self.joint and moves:
            return f'{here}; joint ones are being estimated'
        return f'{here}; joint ones wait until no scan is moved' if self._waits else here

    def keep(self, found: EstimatedPoses) -> None:
        """Hold these poses, and none of before; scans that lie as before stay the same objects."""
        pairs = [self._renewed(*pair) for pair in zip(found.given, found.placed, strict=True)]
        self._held = {id(one.given.belief): one for one in pairs}
        self.trajectory = found.trajectory
        corrections = {
            one.given.scan.stamp_ns: one.placed.pose.compose(one.given.pose.inverse())
            for one in pairs
        }
        self._corrections = sorted(corrections.items(), key=lambda one: one[0])

    def placed(self, scans: Sequence[PlacedScan]) -> list[PlacedScan]:
        """Return given scans where they are now; the same objects for the same scans."""
        if not self._held:
            return list(scans)
        known = {_stamp(one.given) for one in self._held.values()}
        new = [one for one in scans if self._found(one) is None]
        if any(_stamp(one) in known for one in new):
            self.let_go()
            return list(scans)
        for one in new:
            pose = self._correction(one.scan.stamp_ns).compose(one.pose)
            placed = PlacedScan(one.scan, one.belief.carried_to(pose))
            self._held[id(one.belief)] = _Held(one, placed)
        return [self._placed(one) for one in scans]

    def _renewed(self, given: PlacedScan, placed: PlacedScan) -> _Held:
        old = self._found(given)
        if old is not None and old.placed.scan is placed.scan and old.placed.pose == placed.pose:
            return old
        return _Held(given, placed)

    def _found(self, given: PlacedScan) -> _Held | None:
        held = self._held.get(id(given.belief))
        return held if held is not None and held.given.belief is given.belief else None

    def _placed(self, given: PlacedScan) -> PlacedScan:
        held = self._held[id(given.belief)]
        if held.given.scan is not given.scan:
            held = _Held(given, PlacedScan(given.scan, held.placed.belief))
            self._held[id(given.belief)] = held
        return held.placed

    def _correction(self, stamp_ns: int) -> Pose2D:
        """Return what takes a pose as given at a stamp to where it is now, as next to it."""
        at = bisect_left(self._corrections, stamp_ns, key=lambda one: one[0])
        near = self._corrections[max(at - 1, 0) : at + 1]
        return min(near, key=lambda one: abs(one[0] - stamp_ns))[1]

    def let_go(self) -> None:
        """Leave no poses of before."""
        self._held, self._corrections, self.trajectory = {}, [], None

    def forget(self) -> None:
        """Leave no poses of before, and no choice."""
        self.let_go()
        self.joint = None


def _stamp(placed: PlacedScan) -> tuple[str, int]:
    return placed.scan.frame_id, placed.scan.stamp_ns
