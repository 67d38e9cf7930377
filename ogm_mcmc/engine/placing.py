"""Which pose a scan was taken at: scans wait for poses, and none is ever misplaced.

Stamps are integer nanoseconds end to end. A scan is used with the belief at its own stamp,
interpolated between the poses around it; there is no extrapolation. A scan that cannot be placed
is dropped and counted under the reason. The live node, the offline commands and the tests all
run this code.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np

from ogm_mcmc.config import MountConfig
from ogm_mcmc.engine.deskew import bent, last_stamp_ns, time_between_beams
from ogm_mcmc.engine.pose_history import (
    RESTART_AFTER,
    RESTART_NS,
    PoseHistory,
    Unplaceable,
    Waiting,
)
from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.engine.standing_still import StandingStill
from ogm_mcmc.engine.still_clocks import StillClocks
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import (
    PlacedScan,
    Pose2D,
    PoseBelief,
    Scan,
    SensorMount,
)
from ogm_mcmc.geometry.motion import jumps

__all__ = ['DROP_REASONS', 'PoseSource', 'RobotScan', 'ScanPlacer', 'final_belief', 'sensor_mount']

NS_PER_S = 1_000_000_000

# While poses come in, a scan waits for its own, but not longer than so many timeouts.
PATIENCE = 10.0

DROP_REASONS = {
    'scan_out_of_order': 'it is older than the scan before it, or the same scan again',
    'scan_unstamped': 'its stamp has been 0, or the same for more than 1 s: a clock stands still',
    'scan_jumped_back': 'its stamp is more than 1 s before the scan before it, or again and again',
    'pose_out_of_order': 'the pose is not later than the pose before it',
    'pose_unstamped': 'its stamp has been the same for more than 1 s: a clock stands still',
    'pose_jumped_back': 'the pose goes back more than 1 s, or again and again; history restarted',
    'before_restart': 'it waited for a pose when time started again',
    'scan_before_poses': 'it is older than every pose known',
    'pose_gap': 'the poses before and after it are too far apart',
    'pose_jump': 'the poses before and after it are further apart than the robot can go',
    'pose_timeout': 'no pose as late as the scan came in time',
    'queue_full': 'too many scans were waiting for a pose',
    'pose_unusable': 'the pose at its stamp is not level or not finite',
    'pose_unavailable': 'the pose source has no pose at its stamp',
    'scan_no_mount': 'nothing says where its sensor sits on the base at its stamp',
    'scan_bad_mount': 'its sensor is not level with the base',
    'scan_off_map': 'the map would grow too large',
    'pose_wrong_frame': 'the pose is in another frame than the others',
    'scan_invalid': 'the message does not hold a scan',
    'pose_invalid': 'the message does not hold a pose',
}


class PoseSource(Protocol):
    """Where poses come from: a recorded history, or a tf buffer.

    No pose is given between two that are further apart in time, or ask for faster motion.
    """

    max_gap_ns: int
    max_speed_m_s: float
    max_turn_rad_s: float

    def at(self, stamp_ns: int) -> PoseBelief:
        """Return the belief at a stamp; raises Waiting, Unplaceable or PoseError."""
        ...

    def why_not(self, stamp_ns: int) -> str:
        """Return what is missing for a pose at a stamp, for people; empty where nothing is."""
        ...

    def stands_at(self, belief: PoseBelief, stamp_ns: int) -> bool:
        """Return whether what came up to a stamp shows the robot standing where this has it."""
        ...

    def restart(self, stamp_ns: int) -> None:
        """Forget everything that lies ahead of a stamp: time started again there."""
        ...

    def clear(self) -> None:
        """Forget all poses."""
        ...


def final_belief(source: PoseSource, stamp_ns: int) -> PoseBelief:
    """Return the belief at a stamp where nothing is waited for; raises as `PoseSource.at`."""
    try:
        return source.at(stamp_ns)
    except Waiting as waiting:
        if waiting.belief is None:
            raise
        return waiting.belief


class MountSource(Protocol):
    """Where sensors sit on the base."""

    def at(self, frame: str, stamp_ns: int, now_s: float) -> SensorMount:
        """Return the mount of a frame at a stamp; raises Waiting or Unplaceable."""
        ...

    def restart(self, stamp_ns: int) -> None:
        """Forget what moves ahead of a stamp: time started again there."""
        ...


class RobotScan(NamedTuple):
    """A scan as its sensor gave it, and the belief about the *robot's* pose at its stamp.

    It becomes a `PlacedScan` where the mount of the sensor is known (None: not asked for). `way`:
    where the robot was at the last beam, seen from where it was at the first; None where nothing
    is to be bent.
    """

    scan: Scan
    belief: PoseBelief
    mount: SensorMount | None = None
    way: Pose2D | None = None

    def on_mount(self, mount: SensorMount | None = None) -> PlacedScan:
        """Place the scan by its mount (or this one), bent by the robot's way meanwhile."""
        mount = mount or self.mount or SensorMount()
        placed = PlacedScan.on_robot(self.scan, self.belief, mount)
        if self.way is None:
            return placed
        way = mount.pose.inverse().compose(self.way).compose(mount.pose)
        return placed._replace(scan=bent(placed.scan, way))


class _Queued(NamedTuple):
    scan: Scan
    arrived_s: float
    again: bool = False  # of the stamp of the scan before it


class ScanPlacer:
    """Scans in, placed scans out, in the order they came (for one sensor, that of the stamps).

    `timeout_s` bounds how long a scan waits after it and the last new pose came in (ten times as
    long in all), `max_waiting` how many wait at once. With `mounts` a scan waits for that of its
    sensor as well, with `deskew` (auto, on; see `ogm_mcmc.engine.deskew`) for the pose of its
    last beam. Where a pose history falls silent, scans that see what the last placed one saw are
    placed where that was: the robot stands still. `on_drop(reason, scan or None)` is told of
    everything dropped.

    Where it is `live` a scan of the same stamp as the one before it waits for the next stamp: by
    when messages come it shows whether the clock stands still (`StillClocks`), and such scans
    would all lie at one pose. For a recording that is known beforehand (`BagSurvey`).
    """

    def __init__(
        self,
        source: PoseSource,
        *,
        timeout_s: float = 1.0,
        max_waiting: int = 1000,
        mounts: MountSource | None = None,
        deskew: str = 'off',
        live: bool = False,
        on_drop: Callable[[str, Scan | None], None] | None = None,
    ) -> None:
        self.source = source
        self.live = live
        self.timeout_s = timeout_s
        self.max_waiting = max_waiting
        self.mounts = mounts
        self.deskew = deskew
        self.on_drop = on_drop
        self.dropped: Counter[str] = Counter()
        self._waiting: deque[_Queued] = deque()
        self._last_stamp_ns: Recent[int] = Recent()
        self._newest: Scan | None = None
        self._late: Recent[int] = Recent()  # by frame, in a row
        self._last_pose_s = -float('inf')
        self._scan_clocks, self._pose_clock = StillClocks(), StillClocks()
        self._still = StandingStill()
        self.n_held = 0  # placed where the robot still stood

    def __len__(self) -> int:
        """Return how many scans are waiting."""
        return len(self._waiting)

    def drop(self, reason: str, scan: Scan | None = None) -> None:
        """Count something that cannot be used."""
        self.dropped[reason] += 1
        if self.on_drop is not None:
            self.on_drop(reason, scan)

    def add_scan(self, scan: Scan, now_s: float = 0.0) -> None:
        """Queue a scan; `now_s` is the time of arrival on any steady clock."""
        last = self._last_stamp_ns.get(scan.frame_id)
        if last == scan.stamp_ns == 0:
            self.drop('scan_unstamped', scan)
            return
        if last is not None and (scan.stamp_ns < last or _same(scan, self._newest)):
            in_a_row = self._late.get(scan.frame_id, 0) + (scan.stamp_ns < last)
            self._late[scan.frame_id] = in_a_row
            if last - scan.stamp_ns <= RESTART_NS and in_a_row <= RESTART_AFTER:
                self.drop('scan_out_of_order', scan)
                return
            self._late.clear()
            self._restart(scan.stamp_ns)
            self._last_stamp_ns[scan.frame_id] = scan.stamp_ns
            self.drop('scan_jumped_back', scan)
            return
        self._last_stamp_ns[scan.frame_id] = scan.stamp_ns
        self._newest = scan
        self._late[scan.frame_id] = 0
        again = self.live and self._scan_clocks.add(scan.frame_id, scan.stamp_ns, now_s)
        if again and self._scan_clocks.stands(scan.frame_id, scan.stamp_ns):
            self.drop('scan_unstamped', scan)
            return
        if len(self._waiting) >= self.max_waiting:
            self.drop('queue_full', self._waiting.popleft().scan)
        self._waiting.append(_Queued(scan, now_s, again))

    def add_pose(self, stamp_ns: int, belief: PoseBelief, now_s: float = 0.0) -> None:
        """Take a pose into the history (only where the source is a `PoseHistory`)."""
        if not isinstance(self.source, PoseHistory):
            raise TypeError('this placer asks its source for poses; it does not take them')
        reason = self.source.add(stamp_ns, belief)
        again = self.live and self._pose_clock.add('', stamp_ns, now_s)
        if again and self._pose_clock.stands('', stamp_ns):
            reason = 'pose_unstamped'
        if reason is None:
            self._last_pose_s = now_s
        else:
            self.drop(reason)
        if reason == 'pose_jumped_back':
            self._restart(stamp_ns)

    def _restart(self, stamp_ns: int) -> None:
        """Time started again at a stamp: what lies ahead of it belongs to the time before.

        Scans that wait are dropped and counted, older poses forgotten; a scan could otherwise
        meet the poses of another run.
        """
        waiting = list(self._waiting)
        self._waiting.clear()
        self._still.clear()
        for queued in waiting:
            if queued.scan.stamp_ns > stamp_ns + RESTART_NS:
                self.drop('before_restart', queued.scan)
            else:
                self._waiting.append(queued)
        for frame, last in list(self._last_stamp_ns.items()):
            if last > stamp_ns + RESTART_NS:
                del self._last_stamp_ns[frame]
        self.source.restart(stamp_ns)
        if self.mounts is not None:
            self.mounts.restart(stamp_ns)

    def clear(self) -> None:
        """Forget waiting scans and poses, not the counts."""
        self._waiting.clear()
        self._last_stamp_ns.clear()
        self._newest = None
        self._scan_clocks.clear()
        self._pose_clock.clear()
        self.source.clear()
        self._still.clear()

    def flush(self) -> Iterator[RobotScan]:
        """Yield what can be placed and drop the rest: nothing more will come."""
        yield from self.placed(float('inf'))

    def placed(self, now_s: float = 0.0) -> Iterator[RobotScan]:
        """Yield every scan whose pose is known; drop what waited too long or has no place."""
        while self._waiting:
            scan, arrived_s, again = self._waiting[0]
            if again and self._scan_clocks.stands(scan.frame_id, scan.stamp_ns):
                self._waiting.popleft()
                self.drop('scan_unstamped', scan)
                continue
            if again and self._scan_clocks.may_stand(scan.frame_id, scan.stamp_ns, now_s):
                return
            waited_s = now_s - arrived_s
            since_pose_s = now_s - max(arrived_s, self._last_pose_s)
            patient = since_pose_s <= self.timeout_s and waited_s <= PATIENCE * self.timeout_s
            lacking = 'pose_timeout'
            try:
                belief = self._belief(scan.stamp_ns, patient)
                lacking = 'scan_no_mount'
                mount = self._mount(scan, now_s)
                way = self._way(scan, belief, patient)
            except Waiting:
                if patient:
                    return
                self._waiting.popleft()
                yield from self._held(lacking, scan, now_s)
            except Unplaceable as reason:
                self._waiting.popleft()
                yield from self._held(str(reason), scan, now_s)
            except PoseError:
                self._waiting.popleft()
                self.drop('pose_unusable', scan)
            else:
                self._waiting.popleft()
                self._still.placed(scan, belief)
                yield RobotScan(scan, belief, mount, way)

    def _belief(self, stamp_ns: int, patient: bool) -> PoseBelief:
        if patient and len(self._waiting) < self.max_waiting:
            return self.source.at(stamp_ns)
        return final_belief(self.source, stamp_ns)

    def _held(self, reason: str, scan: Scan, now_s: float) -> Iterator[RobotScan]:
        """Yield a scan without a pose where it shows that the robot still stands; else drop it."""
        belief = self._still.belief(scan) if reason in ('pose_timeout', 'pose_gap') else None
        if belief is None or not self.source.stands_at(belief, scan.stamp_ns):
            self.drop(reason, scan)
            return
        try:
            mount = self._mount(scan, now_s)
        except (Waiting, Unplaceable):
            self.drop('scan_no_mount', scan)
            return
        self.n_held += 1
        yield RobotScan(scan, belief, mount)

    def _way(self, scan: Scan, belief: PoseBelief, patient: bool) -> Pose2D | None:
        """Return the robot's way during a sweep, None where it is not asked for or not known."""
        between_s = time_between_beams(scan, self.deskew)
        if between_s == 0.0:
            return None
        last_ns = last_stamp_ns(scan, between_s)
        try:
            last = self.source.at(last_ns).mean
        except Waiting:
            if patient:
                raise
            return None
        except (Unplaceable, PoseError):
            return None
        if jumps(belief.mean, last, last_ns - scan.stamp_ns):
            return None
        return belief.mean.inverse().compose(last)

    def _mount(self, scan: Scan, now_s: float) -> SensorMount | None:
        if self.mounts is None:
            return None
        return self.mounts.at(scan.frame_id, scan.stamp_ns, now_s)


def _same(scan: Scan, before: Scan | None) -> bool:
    """Return whether a scan came twice; several of one stamp are scans of their own."""
    return (
        before is not None
        and (scan.stamp_ns, scan.frame_id) == (before.stamp_ns, before.frame_id)
        and scan.angle_min_rad == before.angle_min_rad
        and np.array_equal(scan.ranges_m, before.ranges_m, equal_nan=True)
    )


def sensor_mount(config: MountConfig, frame_id: str = '') -> SensorMount:
    """Return the mount that parameters describe, for the sensor of a frame."""
    named = _named_mounts(config)
    if frame_id in named:
        *place, upside_down = named[frame_id]
        return SensorMount(Pose2D(*place), upside_down)
    return SensorMount(Pose2D(config.x, config.y, config.yaw), config.upside_down)


@lru_cache(maxsize=8)
def _named_mounts(config: MountConfig) -> dict[str, tuple[float, float, float, bool]]:
    return config.named()
