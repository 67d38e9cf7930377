"""Trajectories as text: TUM, EuRoC, KITTI, g2o and the CSV of `simulate` in, TUM out.

====== ========================================================= ==========================
format a line                                                    stamps
====== ========================================================= ==========================
TUM    `t x y z qx qy qz qw`                                     seconds
EuRoC  `t, x, y, z, qw, qx, qy, qz, ...`                         nanoseconds
KITTI  the upper three rows of the 4 x 4 matrix, 12 numbers      another file: a line each
g2o    `VERTEX_SE2 id x y yaw`, other lines are passed over      another file: `id stamp`
CSV    `stamp_ns,x_m,y_m,yaw_rad`, below a line that says so     nanoseconds
====== ========================================================= ==========================

Stamps are read as decimal numbers, not through floats, so that no nanosecond is lost. Lines that
begin with # are comments. The first other line decides the format.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.errors import PoseError
from ogm_mcmc.files.input_files import reason_of, text_of
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import FURTHEST_M, Pose2D, PoseBelief, pose_from_quaternion

__all__ = [
    'POSE_COLUMNS',
    'ROUNDING_NS',
    'Trajectory',
    'read_trajectory',
    'with_ends_held',
    'write_tum',
]

NS_PER_S = 1_000_000_000

ROUNDING_NS = 1_000_000
"""Stamps in text files are rounded, often to microseconds and at worst to this."""

POSE_COLUMNS = 'stamp_ns', 'x_m', 'y_m', 'yaw_rad'
"""The first line of the CSV that `simulate` writes."""

FORMATS = (
    'TUM (8 numbers), KITTI (12 numbers), EuRoC (8 or more, separated by commas), VERTEX_SE2, or '
    f'a CSV that begins with {",".join(POSE_COLUMNS)}'
)


class Trajectory(NamedTuple):
    """Poses and their stamps (N,) in ns, each later than the one before; `format` by name.

    `deviations` (N, 3): the standard deviations of x, y (m) and yaw (rad), where these are known.
    """

    stamps_ns: Int64Array
    poses: tuple[Pose2D, ...]
    format: str = 'TUM'
    deviations: Float64Array | None = None

    def beliefs(self) -> list[PoseBelief]:
        """Return what is believed of each pose: with a covariance where deviations are known."""
        if self.deviations is None:
            return [PoseBelief(pose) for pose in self.poses]
        return [
            PoseBelief(pose, np.diag(spread**2))
            for pose, spread in zip(self.poses, self.deviations, strict=True)
        ]


class _Line(NamedTuple):
    number: int
    words: list[str]
    commas: bool


class _Posed(NamedTuple):
    """A pose and where it was read; `key`: its stamp in ns, for g2o its id, for KITTI unused."""

    number: int
    key: int
    pose: Pose2D


def read_trajectory(path: Path, stamps: Path | None = None) -> Trajectory:
    """Read a trajectory; `stamps` is the other file where the format keeps no stamps.

    Raises PoseError with file, line and what was expected: for numbers that are missing, no
    numbers or not finite, a pose that is not level or absurdly far away, and stamps that do not
    increase.
    """
    lines = list(_lines(path))
    if not lines:
        raise PoseError(f'{path}: no pose in it: expected {FORMATS}')
    kind = _format_of(path, lines[0])
    read, needs_stamps = READERS[kind]
    if needs_stamps and stamps is None:
        raise PoseError(f'{path}: {kind} keeps no stamps: expected a second file with them')
    if stamps is not None and not needs_stamps:
        raise PoseError(f'{path}: {kind} has its own stamps: expected no file beside it')
    if kind == 'CSV':
        del lines[0]
    read = _within(read)
    posed = [found for line in lines if (found := _read_line(path, line, read))]
    if stamps is not None:
        posed = (_by_id if kind == 'g2o' else _by_place)(path, posed, stamps)
    if not posed:
        what = 'VERTEX_SE2' if kind == 'g2o' else 'pose'
        raise PoseError(f'{path}: no {what} in it: expected poses')
    for earlier, later in pairwise(posed):
        if later.key <= earlier.key:
            raise PoseError(
                f'{path}: line {later.number}: stamp {_seconds(later.key)} s is not later than '
                f'{_seconds(earlier.key)} s in line {earlier.number}'
            )
    keys = np.array([one.key for one in posed], np.int64)
    return Trajectory(keys, tuple(one.pose for one in posed), kind)


def with_ends_held(trajectory: Trajectory) -> Trajectory:
    """Return a trajectory with its first and last pose held by what stamps may be rounded.

    What was measured at the very first or last pose lies beyond it by a rounding of its stamp.
    """
    stamps, poses, spread = trajectory.stamps_ns, trajectory.poses, trajectory.deviations
    return trajectory._replace(
        stamps_ns=np.concatenate((stamps[:1] - ROUNDING_NS, stamps, stamps[-1:] + ROUNDING_NS)),
        poses=(poses[0], *poses, poses[-1]),
        deviations=None if spread is None else np.pad(spread, ((1, 1), (0, 0)), 'edge'),
    )


def write_tum(path: Path, stamps_ns: Iterable[int], poses: Iterable[Pose2D]) -> None:
    """Write a TUM file in full precision, in place when complete. Raises OutputError."""
    rows = []
    for stamp_ns, pose in zip(stamps_ns, poses, strict=True):
        half = 0.5 * pose.yaw_rad
        numbers = (pose.x_m, pose.y_m, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))
        rows.append(f'{_seconds(int(stamp_ns))} {" ".join(map(repr, map(float, numbers)))}\n')
    with replacing(path) as partial:
        partial.write_text(''.join(['# timestamp x y z qx qy qz qw\n', *rows]))


def _lines(path: Path) -> Iterator[_Line]:
    try:
        text = text_of(path)
    except UnicodeDecodeError as error:
        raise PoseError(f'{path}: not a text file: expected a trajectory') from error
    except (OSError, ValueError) as error:
        raise PoseError(f'{path}: cannot be read ({reason_of(error)})') from error
    for number, line in enumerate(text.splitlines(), 1):
        said = line.strip()
        if said and not said.startswith('#'):
            words = said.replace(',', ' ').split()
            if not words:
                raise PoseError(f'{path}: line {number}: only commas: expected numbers')
            yield _Line(number, words, ',' in said)


def _format_of(path: Path, line: _Line) -> str:
    count = len(line.words)
    if line.words[0].startswith(('VERTEX_', 'EDGE_', 'FIX', 'PARAMS_')):
        return 'g2o'
    if tuple(line.words) == POSE_COLUMNS:
        return 'CSV'
    if line.commas and count >= 8:
        return 'EuRoC'
    if not line.commas and count in (8, 12):
        return 'TUM' if count == 8 else 'KITTI'
    raise PoseError(
        f'{path}: line {line.number}: {count} value{"s"[: count != 1]}: expected {FORMATS}'
    )


Reader = Callable[[_Line], _Posed | None]
Read = TypeVar('Read')


def _within(read: Reader) -> Reader:
    """Return what reads a line and refuses a pose further away than any robot is."""

    def checked(line: _Line) -> _Posed | None:
        found = read(line)
        if found is not None and max(abs(found.pose.x_m), abs(found.pose.y_m)) > FURTHEST_M:
            place = f'{found.pose.x_m:g}, {found.pose.y_m:g}'
            raise PoseError(f'position ({place}): expected numbers up to {FURTHEST_M:g} m')
        return found

    return checked


def _read_line(path: Path, line: _Line, read: Callable[[_Line], Read]) -> Read:
    try:
        return read(line)
    except PoseError as error:
        raise PoseError(f'{path}: line {line.number}: {error}') from error


def _tum(line: _Line) -> _Posed:
    _require_count(line, 8)
    stamp_ns = _decimal_ns(line.words[0], NS_PER_S)
    x, y, _, qx, qy, qz, qw = _numbers(line.words[1:])
    return _Posed(line.number, stamp_ns, _level((x, y), (qx, qy, qz, qw)))


def _euroc(line: _Line) -> _Posed:
    # Velocities and biases may follow the pose.
    if len(line.words) < 8:
        raise PoseError(f'{len(line.words)} values: expected 8 or more')
    stamp_ns = _decimal_ns(line.words[0], 1)
    x, y, _, qw, qx, qy, qz = _numbers(line.words[1:8])
    return _Posed(line.number, stamp_ns, _level((x, y), (qx, qy, qz, qw)))


def _csv(line: _Line) -> _Posed:
    _require_count(line, 4)
    x, y, yaw = _numbers(line.words[1:])
    return _Posed(line.number, _decimal_ns(line.words[0], 1), Pose2D(x, y, yaw))


def _kitti(line: _Line) -> _Posed:
    _require_count(line, 12)
    table = np.array(_numbers(line.words)).reshape(3, 4)
    turn = table[:, :3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > 0.02 or np.linalg.det(turn) < 0.0:
        raise PoseError('expected the matrix of a rotation in columns 1 to 3 of each row')
    tilt = math.acos(min(max(float(turn[2, 2]), -1.0), 1.0))
    _level((0.0, 0.0), (0.0, math.sin(tilt / 2), 0.0, math.cos(tilt / 2)))
    yaw = math.atan2(float(turn[1, 0]), float(turn[0, 0]))
    return _Posed(line.number, 0, Pose2D(float(table[0, 3]), float(table[1, 3]), yaw))


def _g2o(line: _Line) -> _Posed | None:
    if line.words[0] != 'VERTEX_SE2':
        if line.words[0].startswith('VERTEX_SE3'):
            raise PoseError('VERTEX_SE3: expected poses in the plane (VERTEX_SE2)')
        return None
    _require_count(line, 5)
    x, y, yaw = _numbers(line.words[2:])
    return _Posed(line.number, _whole(line.words[1]), Pose2D(x, y, yaw))


READERS: dict[str, tuple[Reader, bool]] = {
    'TUM': (_tum, False),
    'EuRoC': (_euroc, False),
    'KITTI': (_kitti, True),
    'g2o': (_g2o, True),
    'CSV': (_csv, False),
}


def _by_place(path: Path, posed: list[_Posed], stamps: Path) -> list[_Posed]:
    """Give each pose the stamp of the line at the same place."""
    known = [_stamp_in(stamps, line, 1) for line in _lines(stamps)]
    if len(known) != len(posed):
        raise PoseError(
            f'{stamps}: {len(known)} stamps: expected {len(posed)}, one a pose of {path}'
        )
    return [one._replace(key=stamp_ns) for one, stamp_ns in zip(posed, known, strict=True)]


def _by_id(path: Path, posed: list[_Posed], stamps: Path) -> list[_Posed]:
    """Give each pose the stamp of its id; a graph need not list them in the order of time."""
    known: dict[int, int] = {}
    for line in _lines(stamps):
        stamp_ns = _stamp_in(stamps, line, 2)
        known[_read_line(stamps, line, lambda line: _whole(line.words[0]))] = stamp_ns
    for one in posed:
        if one.key not in known:
            raise PoseError(f'{stamps}: no stamp for id {one.key} of line {one.number} in {path}')
    return sorted((one._replace(key=known[one.key]) for one in posed), key=lambda one: one.key)


def _stamp_in(path: Path, line: _Line, count: int) -> int:
    def read(line: _Line) -> int:
        _require_count(line, count)
        return _decimal_ns(line.words[-1], NS_PER_S)

    return _read_line(path, line, read)


def _level(position: tuple[float, float], turn: tuple[float, float, float, float]) -> Pose2D:
    pose, upside_down = pose_from_quaternion(position, turn)
    if upside_down:
        raise PoseError('pose is upside down: expected the robot on its feet')
    return pose


def _require_count(line: _Line, count: int) -> None:
    if len(line.words) != count:
        raise PoseError(f'{len(line.words)} values: expected {count}')


def _numbers(words: list[str]) -> list[float]:
    numbers = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise PoseError(f'{word!r}: expected a finite number')
        numbers.append(value)
    return numbers


def _decimal_ns(word: str, factor: int) -> int:
    try:
        stamp_ns = Decimal(word) * factor
        if not stamp_ns.is_finite() or not 0 <= stamp_ns < 2**63:
            raise InvalidOperation
        return int(stamp_ns.to_integral_value())
    except InvalidOperation:
        unit = 's' if factor > 1 else 'ns'
        raise PoseError(f'stamp {word!r}: expected {unit} from 0 on') from None


def _whole(word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise PoseError(f'id {word!r}: expected a whole number') from None


def _seconds(stamp_ns: int) -> str:
    return '{}.{:09d}'.format(*divmod(stamp_ns, NS_PER_S))
