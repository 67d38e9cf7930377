"""A tf buffer without ROS: transforms in, the pose of one frame in another at a stamp out.

It answers as tf2 does: every edge is interpolated at the stamp asked for (translation straight,
orientation by slerp), nothing is extrapolated, static edges hold always, and a frame that gets
another parent keeps the old one up to the first entry under the new one. Beyond tf2:

- A static transform that is corrected counts from its own stamp on (from its arrival, where the
  stamp says nothing), so that earlier scans keep the mount they were taken with.
- Entries further apart than a limit are not interpolated. The limit holds for every edge that
  moves, map -> odom as well: localizers repeat that one even while nothing changes, and one that
  fell silent has lost its place.
- An entry that repeats a stamp replaces the one there. tf2 keeps both, and up to that stamp
  interpolates towards the first of them.

Why not pytransform3d's TemporalTransformManager: it needs SciPy, takes whole arrays at once
rather than entries as they come, copies all matrices of the graph for a path, keeps times in
floats when they are not converted (nanoseconds of today lose 128), joins frames by the shortest
path through any graph (tf is a tree whose edges change over time), and knows neither gaps nor
corrected static transforms. What is left to take over is a bisection and a slerp.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Int64Array
from ogm_mcmc.engine.frame_history import Around, FrameHistory
from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.errors import PoseError, listed
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

__all__ = ['Edge', 'TransformError', 'TransformTree', 'along']

NS_PER_S = 1_000_000_000

# Time that goes back further than this started again.
RESTART_NS = NS_PER_S

# No robot has more; a sender that makes up frames must not fill the memory.
MAX_LIVE_FRAMES = 5000

# 70 MB of them with long names; 30 s of a robot that sends 6 000 a second are fewer.
MAX_LIVE_ENTRIES = 200_000

# So many entries of a frame in a row that are too old are a restart, not late ones; or the one
# they are compared with had a wrong stamp.
RESTART_AFTER = 10

# Up to here what never moves is known.
LATEST_NS = 2**63 - 1


class TransformError(PoseError):
    """No transform between two frames at a stamp.

    `reason`: `unknown` (a frame is not there), `unconnected`, `loop`, `early` and `late` (before
    the first entry of an edge, after its last), `gap`.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


class Edge(NamedTuple):
    """One step of the way between two frames: `up` from child to parent, else down."""

    child: str
    around: Around
    up: bool


class TransformTree:
    """Entries in, in any order and at any time; `lookup` and `edges` out.

    `keep_s` bounds how long an edge is remembered behind its newest entry (for live use); None
    keeps everything.
    """

    def __init__(self, keep_s: float | None = None) -> None:
        self.keep_ns = None if keep_s is None else round(keep_s * NS_PER_S)
        self._frames: dict[str, FrameHistory] = {}  # by child
        self._names: set[str] = set()
        self._n_entries = 0
        self._too_old: Recent[int] = Recent()  # by child, in a row

    # -- entries in -------------------------------------------------------------------------

    def add(
        self, entry: StampedTransform, *, static: bool = False, arrival_ns: int | None = None
    ) -> bool:
        """Take an entry; return False for one too old to be kept: so many in a row are a restart.

        `arrival_ns` says when a static one came, for senders that stamp every one the same.
        Raises PoseError for a frame without a name or that is its own parent, and in live use
        for one frame too many.
        """
        if not entry.parent or not entry.child or entry.parent == entry.child:
            raise PoseError(
                f'transform from {entry.parent!r} to {entry.child!r}: expected two frames'
            )
        history = self._frames.get(entry.child)
        if history is None and self.keep_ns is not None and len(self._frames) >= MAX_LIVE_FRAMES:
            raise PoseError(
                f'transform to {entry.child!r}: expected at most {MAX_LIVE_FRAMES} frames'
            )
        self._names |= {entry.parent, entry.child}
        if history is None or history.static != static:
            # The newest kind counts, as in tf2.
            self._n_entries -= 0 if history is None else len(history)
            history = self._frames[entry.child] = FrameHistory(static)
        before = len(history)
        taken = self._add_to(history, entry, arrival_ns)
        self._n_entries += len(history) - before
        if self.keep_ns is not None:
            self._bound()
        return taken

    def _add_to(
        self, history: FrameHistory, entry: StampedTransform, arrival_ns: int | None
    ) -> bool:
        if history.static:
            history.add_static(entry, arrival_ns)
            return True
        if self.keep_ns is None:
            history.add(entry)
            return True
        newest_ns = max(history.stamps[-1], entry.stamp_ns) if history.stamps else entry.stamp_ns
        if entry.stamp_ns < newest_ns - self.keep_ns:
            return self._is_restart(history, entry)
        self._too_old.pop(entry.child, None)
        history.add(entry)
        history.keep_from(newest_ns - self.keep_ns)
        return True

    def _is_restart(self, history: FrameHistory, entry: StampedTransform) -> bool:
        """Take an entry that is too old where those before it were, too: time restarted.

        For this frame: one of its senders may have a wrong clock. Where all time restarted, so
        do the others by themselves.
        """
        self._too_old[entry.child] = self._too_old.get(entry.child, 0) + 1
        if self._too_old[entry.child] <= RESTART_AFTER:
            return False
        del self._too_old[entry.child]
        history.drop_first(len(history))
        history.add(entry)
        return True

    def _bound(self) -> None:
        """Forget half of the longest history, and parents of before, where there are too many."""
        if self._n_entries > MAX_LIVE_ENTRIES:
            longest = max(self._frames.values(), key=len)
            forgotten = len(longest) // 2
            longest.drop_first(forgotten)
            self._n_entries -= forgotten
        if len(self._names) > 2 * MAX_LIVE_FRAMES:
            self._name_anew()

    def _name_anew(self) -> None:
        self._names = set(self._frames)
        self._names |= {history.latest_parent() for history in self._frames.values()}

    def restart(self, stamp_ns: int) -> None:
        """Forget what moves if any of it lies ahead of a stamp: time started again there.

        Static transforms are sent once and stay, each with its newest entry.
        """
        moving = [history for history in self._frames.values() if not history.static]
        if any(history.stamps[-1] > stamp_ns + RESTART_NS for history in moving):
            self.clear()

    def clear(self) -> None:
        """Forget everything but the newest static transforms."""
        self._frames = {child: h for child, h in self._frames.items() if h.static}
        for history in self._frames.values():
            history.drop_first(len(history) - 1)
        self._n_entries = len(self._frames)
        self._name_anew()

    # -- transforms out ---------------------------------------------------------------------

    def lookup(
        self, target: str, source: str, stamp_ns: int, *, max_gap_ns: int | None = None
    ) -> RigidTransform:
        """Return where `source` lies in `target` at a stamp. Raises TransformError."""
        return along(self.edges(target, source, stamp_ns, max_gap_ns=max_gap_ns))

    def why_not(
        self, target: str, source: str, stamp_ns: int, *, max_gap_ns: int | None = None
    ) -> str:
        """Return what is missing between two frames at a stamp; empty where nothing is."""
        try:
            self.edges(target, source, stamp_ns, max_gap_ns=max_gap_ns)
        except TransformError as error:
            return str(error)
        return ''

    def edges(
        self, target: str, source: str, stamp_ns: int, *, max_gap_ns: int | None = None
    ) -> list[Edge]:
        """Return the way from `source` to `target` at a stamp, in this order.

        Raises TransformError where there is none; what lies above the frame in which the ways up
        from both meet does not matter.
        """
        if source == target:
            return []
        self._require_known(target, source)
        climbed, failed = self._climb(source, stamp_ns, {target})
        met = _parents(source, climbed)
        descent: list[Edge] = []
        if target not in met:
            descent, failed_down = self._climb(target, stamp_ns, set(met))
            failed = failed or failed_down
        meeting = _parents(target, descent)[-1]
        if meeting not in met:
            raise failed or self._unconnected(target, source)
        way = climbed[: met.index(meeting)]
        way += [edge._replace(up=False) for edge in reversed(descent)]
        for edge in way:
            if max_gap_ns is not None and edge.around.apart_ns > max_gap_ns:
                raise TransformError(
                    'gap',
                    f'{edge.around.parent} -> {edge.child}: entries {edge.around.apart_ns / 1e9:g}'
                    f' s apart around {stamp_ns / 1e9:.3f} s: '
                    f'expected at most {max_gap_ns / 1e9:g} s',
                )
        return way

    def _climb(
        self, frame: str, stamp_ns: int, goals: set[str]
    ) -> tuple[list[Edge], TransformError | None]:
        """Go up from a frame to the first of the goals, the root, or where entries are missing."""
        steps: list[Edge] = []
        seen = {frame}
        while frame not in goals and (history := self._frames.get(frame)) is not None:
            if not history.covers(stamp_ns):
                return steps, _uncovered(frame, history, stamp_ns)
            around = history.around(stamp_ns)
            steps.append(Edge(frame, around, True))
            frame = around.parent
            if frame in seen:
                ring = ' -> '.join([step.child for step in steps] + [frame])
                raise TransformError('loop', f'frames in a ring: {ring}; expected a tree')
            seen.add(frame)
        return steps, None

    def newest_common_ns(self, target: str, source: str) -> int | None:
        """Return up to which stamp every moving edge between two frames is known.

        None while they are not connected; where nothing moves, the largest stamp there is.
        """
        moving = self._moving(target, source)
        if moving is None:
            return None
        return min((history.stamps[-1] for history in moving), default=LATEST_NS)

    def moving_stamps(self, target: str, source: str) -> list[Int64Array] | None:
        """Return the stamps of each moving edge between two frames by their newest parents.

        None while they are not connected.
        """
        moving = self._moving(target, source)
        if moving is None:
            return None
        return [np.array(history.stamps, np.int64) for history in moving]

    def moves(self, target: str, source: str) -> bool:
        """Return whether anything between two frames moves (or might: it is sent repeatedly)."""
        return bool(self._moving(target, source))

    def constant(self, target: str, source: str) -> RigidTransform | None:
        """Return where `source` lies in `target` if every entry between them says the same."""
        moving = self._moving(target, source)
        if moving is None or not all(history.constant for history in moving):
            return None
        up, down = self.ancestors(source), self.ancestors(target)
        shared = next(frame for frame in up if frame in down)
        climbed, descended = (
            self._newest_along(frames[: frames.index(shared)]) for frames in (up, down)
        )
        return descended.inverse().compose(climbed)

    def _newest_along(self, children: list[str]) -> RigidTransform:
        """Return where the first of some frames, each the child of the next, lies."""
        result = RigidTransform()
        for child in children:
            result = self._frames[child].newest().compose(result)
        return result

    def _moving(self, target: str, source: str) -> list[FrameHistory] | None:
        up, down = self.ancestors(source), self.ancestors(target)
        shared = next((frame for frame in up if frame in down), None)
        if shared is None or not {target, source} <= self._names:
            return None
        children = up[: up.index(shared)] + down[: down.index(shared)]
        return [self._frames[child] for child in children if not self._frames[child].static]

    def ancestors(self, frame: str) -> list[str]:
        """Return a frame, its newest parent, and so on up to the root."""
        chain = [frame]
        while (history := self._frames.get(chain[-1])) is not None:
            parent = history.latest_parent()
            if parent in chain:
                break
            chain.append(parent)
        return chain

    def is_moving(self, child: str) -> bool:
        """Return whether a frame moves in its parent (or might: it is sent again and again)."""
        history = self._frames.get(child)
        return history is not None and not history.static

    def moves_apart(self, base: str, frame: str) -> bool:
        """Return whether the base moves in the frame that it shares with another.

        So it is with a sensor of another robot in the same map; one that moves on this robot
        hangs below its base, and what is repeated without change does not move.
        """
        if self.constant(base, frame) is not None:
            return False
        up, down = self.ancestors(frame), self.ancestors(base)
        shared = next((one for one in down if one in up), base)
        return any(map(self.is_moving, down[: down.index(shared)]))

    def frames(self) -> list[str]:
        """Return all frames by name."""
        return sorted(self._names)

    def __str__(self) -> str:
        """Return the trees on one line: `map > odom > base_link; world > camera`."""
        branches = [' > '.join(reversed(chain)) for chain in self._branches()]
        return listed(branches, '; ') or 'nothing'

    def _branches(self) -> Iterator[list[str]]:
        parents = {history.latest_parent() for history in self._frames.values()}
        for frame in self.frames():
            if frame in self._frames and frame not in parents:
                yield self.ancestors(frame)

    def _require_known(self, *frames: str) -> None:
        for frame in frames:
            if frame not in self._names:
                held = listed(self.frames()) or 'none'
                raise TransformError('unknown', f'frame {frame!r} is not there; known: {held}')

    def _unconnected(self, target: str, source: str) -> TransformError:
        return TransformError(
            'unconnected', f'{target!r} and {source!r} are not connected (trees: {self})'
        )


def along(edges: list[Edge]) -> RigidTransform:
    """Return where the first frame of a way lies in its last."""
    result = RigidTransform()
    for edge in edges:
        step = edge.around.transform
        result = (step if edge.up else step.inverse()).compose(result)
    return result


def _parents(frame: str, steps: list[Edge]) -> list[str]:
    return [frame, *(step.around.parent for step in steps)]


def _uncovered(child: str, history: FrameHistory, stamp_ns: int) -> TransformError:
    edge = f'{history.latest_parent()} -> {child}'
    first, last = history.stamps[0], history.stamps[-1]
    reason, where = ('early', 'earlier') if stamp_ns < first else ('late', 'later')
    return TransformError(
        reason,
        f'stamp {stamp_ns / 1e9:.3f} s is {where} than all of {edge} '
        f'({first / 1e9:.3f} to {last / 1e9:.3f} s)',
    )
