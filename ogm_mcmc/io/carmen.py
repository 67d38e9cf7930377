"""Parse CARMEN logs (old and new format) and GMapping's .gfs, plain or gzipped.

Lines read: FLASER, RLASER (old), ROBOTLASERn (new), ODOM, PARAM, and of GMapping's full output
LASER_READING, SM_UPDATE and RESAMPLE. RAWLASERn, which names no pose, is used where nothing else
holds readings: the odometry says where the robot was (`carmen_raw`). Everything else is counted
and left alone. Values stay as in the file; what they mean in ROS is decided in `carmen_import`. A
damaged line costs that line.
"""

from __future__ import annotations

import gzip
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import LogError, PoseError
from ogm_mcmc.files.input_files import file_to_read, reason_of
from ogm_mcmc.geometry import PoseSamples
from ogm_mcmc.io.carmen_lines import LineParser, LogOdometry, LogScan, fault
from ogm_mcmc.io.carmen_raw import MAX_GAP_S, RawLines, place_raw_scans

__all__ = ['CarmenLog', 'LogOdometry', 'LogScan', 'particle_weights', 'read_carmen']

# An ODOM line with the pose of the scan before it is odometry if it comes within this time.
ECHO_AFTER_S = 5.0

# No line is longer: 10 000 readings, or as many particles, take a tenth of it. Bytes.
LONGEST_LINE = 4_000_000

LASER_KINDS = ('FLASER', 'RLASER', 'ROBOTLASER', 'LASER_READING')


@dataclass
class CarmenLog:
    """All of a log, in the order of the file."""

    path: Path
    records: list[LogScan | LogOdometry] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    left_alone: Counter[str] = field(default_factory=Counter)
    gmapping: bool = False
    echoes: int = 0  # ODOM lines that only repeat the scan before them, see `_LineReader.is_echo`
    damaged: int = 0  # lines left out, the first of them in words
    first_damage: str = ''
    without_angles: Counter[int] = field(default_factory=Counter)  # scans left out, by readings
    without_particles: int = 0  # scans left out, of a log whose other scans have particles
    raw_scans: int = 0  # scans of lines without a pose, placed by the odometry
    without_odometry: int = 0  # such scans left out: the odometry does not cover them
    cut: str = ''  # what ends the file too early

    @property
    def scans(self) -> list[LogScan]:
        """The laser lines."""
        return [record for record in self.records if isinstance(record, LogScan)]


def particle_weights(log_weights: Float64Array) -> Float64Array:
    """Weights of GMapping particles: exp(g (lw - max lw)) with g = 1 / (3 M), normalised.

    3 is GMapping's `ogain`; log_weights (M,) as printed in SM_UPDATE.
    """
    gain = 1.0 / (3.0 * log_weights.size)
    weights: Float64Array = np.exp(gain * (log_weights - log_weights.max()))
    weights /= weights.sum()
    return weights


def read_carmen(path: Path, field_of_view_rad: float = 0.0) -> CarmenLog:
    """Read a whole log; a damaged line is left out and counted, and so is one cut off at the end.

    field_of_view_rad: angle from the first to the last reading, the middle one straight ahead, of
    lines that name no angles; 0: by CARMEN's rule, which knows few numbers of readings.
    Raises LogError with the line and the field at fault: not readable, no laser line at all, or
    most of its lines or most of its laser lines damaged.
    """
    log = CarmenLog(path)
    reader = _LineReader(log, field_of_view_rad)
    try:
        with file_to_read(path) as raw:
            packed = raw.read(2) == b'\x1f\x8b'
            raw.seek(0)
            stream = cast(BinaryIO, gzip.GzipFile(fileobj=raw)) if packed else raw
            for number, line in enumerate(_lines(stream), start=1):
                reader.take(number, line)
    except EOFError:
        log.cut = 'the gzip stream ends too early'
    except LogError:
        raise
    except (OSError, ValueError, zlib.error) as error:
        raise LogError(f'{path}: expected a readable log ({reason_of(error)})') from error
    reader.finish()
    return log


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the lines, whatever ends them; of one that is too long only the beginning."""
    rest, skipping = b'', False
    while piece := stream.readline(LONGEST_LINE + 1):
        *whole, rest = (rest + piece).splitlines(keepends=True)
        if rest.endswith(b'\n'):  # a carriage return waits for what follows it
            whole, rest = [*whole, rest], b''
        for line in whole:
            if not skipping:
                yield line
            skipping = False
        if len(rest) > LONGEST_LINE and not rest.endswith(b'\r'):
            if not skipping:
                yield rest
            rest, skipping = b'', True
    if rest and not skipping:
        yield rest


class _LineReader:
    """Turns lines into records; keeps the scan that waits for its particles."""

    def __init__(self, log: CarmenLog, field_of_view_rad: float = 0.0) -> None:
        self.log = log
        self.parse = LineParser(field_of_view_rad)
        self.last_scan: LogScan | None = None  # None, too, after a damaged one
        self.good_lines = 0
        self.damaged_scans = 0
        self.posed = False  # whether any line names the pose of its scan
        self.raw = RawLines(field_of_view_rad)

    def take(self, number: int, raw: bytes) -> None:
        # Names and remarks may be in any encoding, or none.
        words = raw.removeprefix(b'\xef\xbb\xbf').decode('ascii', 'replace').split()
        if not words or words[0].startswith('#'):
            return
        n_records = len(self.log.records)
        try:
            if len(raw) > LONGEST_LINE:
                raise fault(number, 'the line', f'at most {LONGEST_LINE} bytes')
            self.line(number, words)
            if not raw.endswith((b'\n', b'\r')):
                self.check_end(number, words[0], n_records)
        except LogError as error:
            self.leave_out(words[0], str(error))
        else:
            self.good_lines += 1

    def leave_out(self, kind: str, damage: str) -> None:
        self.log.damaged += 1
        self.log.first_damage = self.log.first_damage or damage
        if kind.startswith(LASER_KINDS):
            self.damaged_scans += 1
            self.last_scan = None
        elif kind == 'RESAMPLE':
            self.forget_descent()

    def forget_descent(self) -> None:
        for scan in reversed(self.log.records):
            if isinstance(scan, LogScan):
                scan.parents = np.zeros(0, np.int64)
                break

    def check_end(self, number: int, kind: str, n_records: int) -> None:
        """Doubt a last line that nothing ends: its last number may have lost digits."""
        if kind.startswith('RAWLASER'):
            self.raw.doubt_last()
            return
        records = self.log.records
        cut_time = len(records) > max(n_records, 1) and records[-1].time_s < records[-2].time_s
        if cut_time or kind in ('SM_UPDATE', 'RESAMPLE'):
            del records[n_records:]
            if kind == 'SM_UPDATE' and self.last_scan is not None:
                self.last_scan.particles = self.last_scan.log_weights = None
            raise fault(number, f'{kind} line is cut off', 'the end of a line')

    def finish(self) -> None:
        """Judge the whole log."""
        log = self.log
        if not log.scans:
            self.use_raw()
        scans = log.scans
        log.without_angles = self.parse.without_angles
        worst = log.damaged > self.good_lines or self.damaged_scans > len(scans)
        if log.damaged and (worst or not scans):
            lines = log.damaged + self.good_lines
            raise LogError(
                f'{log.path}, {log.first_damage} ({log.damaged} of {lines} lines cannot be used)'
            )
        if not scans:
            reasons = [why for why in (self.unplaced(), log.cut) if why]
            why = f' ({", ".join(reasons)})' if reasons else ''
            raise LogError(
                f'{log.path}: no laser line in it{why}: '
                'expected FLASER, RLASER, ROBOTLASER1 or LASER_READING, or RAWLASER1 with ODOM'
            )
        if any(scan.particles is not None for scan in scans):
            self.keep_placed()

    def unplaced(self) -> str:
        """Say why no raw line was of use, if there are any."""
        if not self.raw.scans:
            return ''
        why = (
            f'none at or between ODOM lines that are at most {MAX_GAP_S:g} s apart and do not jump'
        )
        if not any(isinstance(record, LogOdometry) for record in self.log.records):
            why = 'no ODOM line'
        return f'{len(self.raw.scans)} RAWLASER lines, but {why}'

    def use_raw(self) -> None:
        """Take the lines without a pose, placed by the odometry, for want of others."""
        log, raw = self.log, self.raw
        log.damaged += raw.damaged
        self.damaged_scans += raw.damaged
        log.first_damage = log.first_damage or raw.first_damage
        self.parse.without_angles += raw.parse.without_angles
        self.good_lines -= raw.damaged
        log.records = place_raw_scans(raw.among(log.records), log.parameters)
        log.raw_scans = len(log.scans)
        log.without_odometry = len(raw.scans) - log.raw_scans
        for kind in [kind for kind in log.left_alone if kind.startswith('RAWLASER')]:
            del log.left_alone[kind]

    def keep_placed(self) -> None:
        """Leave out scans without particles: the pose in the line is raw odometry.

        Among the others it would be in another frame.
        """
        kept: list[LogScan | LogOdometry] = []
        last: LogScan | None = None
        for record in self.log.records:
            if isinstance(record, LogScan) and record.particles is None:
                self.log.without_particles += 1
                if last is not None and record.parents is not None:
                    last.parents = np.zeros(0, np.int64)
                continue
            last = record if isinstance(record, LogScan) else last
            kept.append(record)
        self.log.records = kept

    def line(self, number: int, words: list[str]) -> None:
        kind = words[0]
        try:
            if kind in ('FLASER', 'RLASER'):
                self.keep(self.parse.old_laser(number, kind, words))
            elif kind.startswith('ROBOTLASER'):
                self.keep(self.parse.robot_laser(number, words))
            elif kind == 'LASER_READING':
                self.log.gmapping = True
                self.keep(self.parse.gmapping_laser(number, words))
            elif kind == 'SM_UPDATE':
                self.particles(number, words)
            elif kind == 'RESAMPLE':
                self.resampling(number, words)
            elif kind == 'ODOM':
                self.keep_odometry(self.parse.odometry(number, words))
            elif kind.startswith('RAWLASER') and not self.posed:
                self.log.left_alone[kind] += 1
                self.raw.take(number, words, len(self.log.records))
            elif kind == 'PARAM' and len(words) > 2:
                self.log.parameters.setdefault(words[1], words[2])
            else:
                plain = kind.isascii() and kind.isprintable() and len(kind) <= 40
                self.log.left_alone[kind if plain else 'unreadable'] += 1
        except IndexError as error:
            wanted = f'more than {len(words)} fields (is the file cut off?)'
            raise fault(number, f'{kind} line ends too early', wanted) from error
        except PoseError as error:
            raise fault(number, f'{kind}: {error}', 'a pose') from error

    def keep(self, scan: LogScan) -> None:
        self.posed = True
        self.last_scan = scan
        self.log.records.append(scan)

    def keep_odometry(self, odometry: LogOdometry) -> None:
        if self.is_echo(odometry):
            self.log.echoes += 1
        else:
            self.log.records.append(odometry)

    def is_echo(self, odometry: LogOdometry) -> bool:
        """Whether the line only repeats the scan before it.

        GMapping's gfs2log writes after each FLASER an ODOM with the same pose whose time is 0 or
        uninitialised memory; sorted by time such lines would land anywhere. A robot that stands
        still has the same pose, too, but its time follows.
        """
        before = self.log.records[-1] if self.log.records else None
        if not isinstance(before, LogScan) or odometry.pose != before.laser_pose:
            return False
        return not 0.0 <= odometry.time_s - before.time_s <= ECHO_AFTER_S

    def particles(self, line: int, words: list[str]) -> None:
        """SM_UPDATE m (x y theta log_weight)...: the belief about the scan before it."""
        if self.last_scan is None and self.damaged_scans:
            return  # of a scan that was left out
        if self.last_scan is None:
            raise fault(line, 'SM_UPDATE before any LASER_READING', 'the scan first')
        count = self.parse.count(line, words, 1, 'number of particles')
        table = self.parse.readings(line, words, 2, 4 * count).reshape(count, 4)
        if not np.isfinite(table).all():
            raise fault(line, 'a particle is not finite', 'finite numbers')
        self.last_scan.particles = PoseSamples(
            np.ascontiguousarray(table[:, :3]), particle_weights(table[:, 3])
        )
        self.last_scan.log_weights = np.ascontiguousarray(table[:, 3])

    def resampling(self, line: int, words: list[str]) -> None:
        """RESAMPLE m parents...: which of the particles before each of the next descends from."""
        if self.last_scan is None and self.damaged_scans:
            self.forget_descent()
            return
        if self.last_scan is None or self.last_scan.log_weights is None:
            raise fault(line, 'RESAMPLE before any SM_UPDATE', 'the particles first')
        count = self.parse.count(line, words, 1, 'number of particles')
        parents = self.parse.readings(line, words, 2, count)
        known = np.isin(parents, np.arange(self.last_scan.log_weights.size)).all()
        if count != self.last_scan.log_weights.size or not known:
            wanted = f'{self.last_scan.log_weights.size} of the particles before'
            raise fault(line, 'RESAMPLE names others', wanted)
        self.last_scan.parents = parents.astype(np.int64)
