"""Recent beliefs about a pose, and the one at a stamp: interpolated, never extrapolated."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TypedDict

from ogm_mcmc.geometry import PoseBelief, interpolate
from ogm_mcmc.geometry.motion import MAX_SPEED_M_S, MAX_TURN_RAD_S, jumps

__all__ = ['RESTART_AFTER', 'RESTART_NS', 'PoseHistory', 'PoseLimits', 'Unplaceable', 'Waiting']

NS_PER_S = 1_000_000_000

# Stamps that go back further than this are a restart (a bag played again), not a late message.
RESTART_NS = NS_PER_S

# Nor are so many in a row that go back less: a bag of under a second played again.
RESTART_AFTER = 10

# 64 MB of them.
MAX_PARTICLES = 2_000_000


class PoseLimits(TypedDict):
    """Limits that every source of poses takes."""

    max_gap_s: float
    max_speed_m_s: float
    max_turn_rad_s: float


class Waiting(Exception):  # noqa: N818 - a state, not an error
    """The pose may still come; `belief` is what to take where it does not (None: nothing)."""

    def __init__(self, belief: PoseBelief | None = None) -> None:
        super().__init__()
        self.belief = belief


class Unplaceable(Exception):  # noqa: N818 - an answer, not an error
    """The pose will not come; `args[0]` is one of `DROP_REASONS`."""


class PoseHistory:
    """Recent beliefs about the robot's pose, in order of their stamps.

    Between two poses the belief is interpolated, unless they are more than `max_gap_s` apart or
    imply that the robot moved faster than `max_speed_m_s` or turned faster than `max_turn_rad_s`
    (a localizer that found its place again: what lies between is no place where it was). At the
    very stamp of a pose that is as far from the one before it, the next one tells: from a stray
    pose it is as far again. Where no next one comes nothing contradicts it (a localizer found its
    place, and stands). At most `2 keep` poses are held, and of clouds so many that they have
    `MAX_PARTICLES` particles.
    """

    def __init__(
        self,
        *,
        max_gap_s: float = 2.0,
        keep: int = 10_000,
        max_speed_m_s: float = MAX_SPEED_M_S,
        max_turn_rad_s: float = MAX_TURN_RAD_S,
    ) -> None:
        self.max_gap_ns = round(max_gap_s * NS_PER_S)
        self.max_speed_m_s = max_speed_m_s
        self.max_turn_rad_s = max_turn_rad_s
        self.keep = keep
        self.stamps: list[int] = []
        self.beliefs: list[PoseBelief] = []
        self._late = 0  # in a row
        self._particles = 0

    def add(self, stamp_ns: int, belief: PoseBelief) -> str | None:
        """Take a pose; return the reason when it was dropped (or restarted the history)."""
        restarted = bool(self.stamps) and stamp_ns <= self.stamps[-1]
        if restarted:
            # A source that repeats one stamp is stuck, not restarted.
            self._late += stamp_ns < self.stamps[-1]
            if self.stamps[-1] - stamp_ns <= RESTART_NS and self._late <= RESTART_AFTER:
                return 'pose_out_of_order'
            self.clear()
        self._late = 0
        self.stamps.append(stamp_ns)
        self.beliefs.append(belief)
        self._particles += _size(belief)
        if len(self.stamps) > 2 * self.keep:
            self._forget(len(self.stamps) - self.keep)
        elif self._particles > MAX_PARTICLES and len(self.stamps) > 2:
            self._forget(len(self.stamps) // 2)
        return 'pose_jumped_back' if restarted else None

    def stands_at(self, belief: PoseBelief, stamp_ns: int) -> bool:
        """Return whether the last pose up to a stamp is as good as this one."""
        k = bisect_right(self.stamps, stamp_ns) - 1
        if k < 0:
            return False
        return not jumps(belief.mean, self.beliefs[k].mean, 0)

    def why_not(self, stamp_ns: int) -> str:
        """Return which poses are known, for people."""
        if not self.stamps:
            return 'no pose is known'
        first, last = self.stamps[0] / NS_PER_S, self.stamps[-1] / NS_PER_S
        return f'poses from {first:.3f} to {last:.3f} s are known'

    def _forget(self, count: int) -> None:
        self._particles -= sum(map(_size, self.beliefs[:count]))
        del self.stamps[:count], self.beliefs[:count]

    def restart(self, stamp_ns: int) -> None:
        """Forget all poses if any lies ahead of a stamp: time started again there."""
        if self.stamps and self.stamps[-1] > stamp_ns + RESTART_NS:
            self.clear()

    def clear(self) -> None:
        """Forget all poses."""
        self.stamps.clear()
        self.beliefs.clear()
        self._late = self._particles = 0

    def at(self, stamp_ns: int) -> PoseBelief:
        """Return the belief at a stamp; raises Waiting or Unplaceable."""
        later = bisect_left(self.stamps, stamp_ns)
        if later == len(self.stamps):
            raise Waiting
        if self.stamps[later] == stamp_ns:
            self._refuse_stray(later)
            return self.beliefs[later]
        if later == 0:
            raise Unplaceable('scan_before_poses')
        start, end = self.stamps[later - 1], self.stamps[later]
        if end - start > self.max_gap_ns:
            raise Unplaceable('pose_gap')
        before, after = self.beliefs[later - 1], self.beliefs[later]
        if self._jumps_to(later):
            raise Unplaceable('pose_jump')
        return _between(before, after, (stamp_ns - start) / (end - start))

    def _jumps_to(self, k: int) -> bool:
        """Return whether a pose is further from the one before it than the robot can go."""
        apart_ns = self.stamps[k] - self.stamps[k - 1]
        limits = self.max_speed_m_s, self.max_turn_rad_s
        return jumps(self.beliefs[k - 1].mean, self.beliefs[k].mean, apart_ns, *limits)

    def _refuse_stray(self, k: int) -> None:
        """Raise Unplaceable for a pose away from both its neighbours, Waiting for the next one."""
        if k == 0 or not self._jumps_to(k):
            return
        if k + 1 == len(self.stamps):
            raise Waiting(self.beliefs[k])
        if self._jumps_to(k + 1):
            raise Unplaceable('pose_jump')


def _size(belief: PoseBelief) -> int:
    return 0 if belief.particles is None else belief.particles.weights.size


def _between(earlier: PoseBelief, later: PoseBelief, fraction: float) -> PoseBelief:
    mean = interpolate(earlier.mean, later.mean, fraction)
    covariance = None
    if earlier.covariance is not None and later.covariance is not None:
        covariance = (1.0 - fraction) * earlier.covariance + fraction * later.covariance
    nearer = earlier if fraction < 0.5 else later
    particles = nearer._replace(covariance=None).carried_to(mean).particles
    return PoseBelief(mean, covariance, particles)
