"""Logs that are broken: a damaged line costs that line, a damaged log is one clear error."""

import gzip
import random
import tracemalloc

import pytest
from support.refusals import refusal_of

from ogm_mcmc.errors import LogError
from ogm_mcmc.io.carmen import read_carmen

REST = ' '.join(['2.5'] * 179)
FLASER = f'FLASER 180 0.5 {REST} 1.25 -2.5 0.75 70 80 0.9 12.5 host 0.25'
ROBOTLASER = (
    'ROBOTLASER1 0 -1.5 3.0 0.25 50.0 0.01 0 3 1.0 60.0 2.0 2 900 901 '
    '1.25 -2.5 0.75 70 80 0.9 0.1 0.2 0.3 0.4 0.5 13.5 host 0.25'
)
LASER_READING = f'LASER_READING 180 0.5 {REST} 1.25 -2.5 0.75 12.5'
SM_UPDATE = 'SM_UPDATE 2 1 2 0.5 -3.5 3 4 -0.5 -4.5'
ODOM = 'ODOM 1.5 2.5 0.5 0.25 -0.125 9.0 12.75 host 0.5'


def message_of(path):
    message = refusal_of(LogError, read_carmen, path)
    assert str(path) in message
    assert 'expected' in message
    return message


def fault_in_line_2(write_log, line):
    """The line is left out, the others stay, and what is said of it is returned."""
    log = read_carmen(write_log(FLASER, line, FLASER))
    assert (log.damaged, [scan.line for scan in log.scans]) == (1, [1, 3])
    assert log.first_damage.startswith('line 2: ')
    assert 'expected' in log.first_damage
    assert '\n' not in log.first_damage
    return log.first_damage


@pytest.mark.parametrize(
    ('line', 'words_needed'),
    [(FLASER, 189), (ROBOTLASER, 27), (LASER_READING, 186), (SM_UPDATE, 10), (ODOM, 5)],
    ids=['FLASER', 'ROBOTLASER1', 'LASER_READING', 'SM_UPDATE', 'ODOM'],
)
def test_line_cut_off_anywhere(write_log, line, words_needed):
    words = line.split()
    assert read_carmen(write_log(FLASER, ' '.join(words[:words_needed])))
    for kept in range(1, words_needed):
        message = fault_in_line_2(write_log, ' '.join(words[:kept]))
        assert words[0] in message
        assert 'too early' in message


@pytest.mark.parametrize('kept', [6, 7])
def test_odometry_cut_off_before_its_time(write_log, kept):
    """`ODOM x y theta tv rv` is no line of either format; tv must not be taken for the time."""
    fault_in_line_2(write_log, ' '.join(ODOM.split()[:kept]))


@pytest.mark.parametrize(
    ('line', 'field'),
    [
        (FLASER.replace(' 1.25 ', ' 1,25 '), 'x'),
        (FLASER.replace(' -2.5 ', ' nan '), 'y'),
        (FLASER.replace(' 0.75 ', ' inf '), 'theta'),
        (FLASER.replace(' 1.25 ', ' 2e7 '), 'position (2e+07, -2.5)'),
        (FLASER.replace(' 12.5 ', ' soon '), 'time'),
        (FLASER.replace(' 12.5 ', ' nan '), 'time'),
        (FLASER.replace(' 0.5 ', ' 0.5.5 '), 'range'),
        (ROBOTLASER.replace(' -1.5 ', ' left '), 'start angle'),
        (ROBOTLASER.replace(' 0.25 50', ' nan 50'), 'resolution'),
        (ROBOTLASER.replace(' 50.0 ', ' far '), 'maximum range'),
        (ROBOTLASER.replace(' 2.0 2 ', ' 2.0 two '), 'remissions'),
        (ROBOTLASER.replace(' 1.25 ', ' -inf '), 'x'),
        (ODOM.replace(' 0.25 ', ' fast '), 'tv'),
        (ODOM.replace(' -0.125 ', ' nan '), 'rv'),
        (ODOM.replace(' 12.75 ', ' 1e999 '), 'time'),
        (SM_UPDATE.replace(' -3.5 ', ' nan '), 'particle'),
        (SM_UPDATE.replace(' 0.5 ', ' inf '), 'particle'),
        (SM_UPDATE.replace(' 0.5 ', ' x '), 'number'),
    ],
)
def test_number_that_is_none(write_log, line, field):
    assert field in fault_in_line_2(write_log, line)


@pytest.mark.parametrize('count', ['-3', '0', '2.5', 'nan', 'inf', 'many', '4000', '1e300'])
@pytest.mark.parametrize('line', [FLASER, LASER_READING, ROBOTLASER, SM_UPDATE])
def test_count_that_cannot_be(write_log, line, count):
    number = {'FLASER': '180', 'LASER_READING': '180', 'ROBOTLASER1': '3', 'SM_UPDATE': '2'}
    kind = line.split()[0]
    fault_in_line_2(write_log, line.replace(f' {number[kind]} ', f' {count} ', 1))


@pytest.mark.parametrize('count', ['-2', '-1', '0.5', '1.5', '-4000', '4000', 'nan'])
def test_number_of_remissions_that_cannot_be(write_log, count):
    """A wrong one would shift the fields behind it and give another pose and time."""
    fault_in_line_2(write_log, ROBOTLASER.replace(' 2.0 2 ', f' 2.0 {count} '))


@pytest.mark.parametrize('count', [1, 7, 179, 182, 541])
def test_unknown_number_of_beams(write_log, laser_line, count):
    line = laser_line(1.0, [2.5] * count)
    message = fault_in_line_2(write_log, line)
    assert f'{count} readings' in message
    assert 'one of 180, 181, 360, 361, 401, or --field-of-view' in message
    assert read_carmen(write_log(FLASER, line, line, FLASER)).without_angles == {count: 2}


def test_particles_before_any_scan(write_log):
    log = read_carmen(write_log('PARAM a b', SM_UPDATE, LASER_READING))
    assert (log.damaged, len(log.scans)) == (1, 1)
    assert log.first_damage.startswith('line 2: SM_UPDATE before any')


@pytest.mark.parametrize('lines', [[], ['# nothing'], [ODOM, 'NEFF 3'], ['\0' * 100]])
def test_no_laser_line(write_log, lines):
    message = message_of(write_log(*lines))
    assert 'no laser line' in message
    assert 'FLASER' in message


def test_binary_file(tmp_path):
    path = tmp_path / 'binary.log'
    path.write_bytes(random.Random(3).randbytes(10_000))
    assert 'no laser line' in message_of(path)


@pytest.mark.parametrize('share', [0.01, 0.5, 0.99])
def test_truncated_gzip(write_log, share):
    """Scans are read as far as they go; their number is that of the whole lines in the file."""
    rng = random.Random(5)
    noisy = [FLASER.replace(' 0.5 ', f' {rng.random()} ') for _ in range(300)]
    packed = gzip.compress(write_log(*noisy).read_bytes())
    path = write_log(name='cut.log.gz')
    path.write_bytes(packed[: int(share * len(packed))])
    if share < 0.1:
        assert 'the gzip stream ends too early' in message_of(path)
        return
    log = read_carmen(path)
    assert log.cut == 'the gzip stream ends too early'
    assert (share - 0.3) * 300 < len(log.scans) < 300
    first = float(noisy[0].split()[2])
    assert log.scans[0].ranges_m[0] == first


def test_damaged_gzip(write_log):
    packed = bytearray(gzip.compress(write_log(FLASER).read_bytes()))
    packed[len(packed) // 2] ^= 0xFF
    path = write_log(name='damaged.log.gz')
    path.write_bytes(packed)
    message_of(path)


def test_missing_file_and_folder(tmp_path):
    assert 'No such file' in message_of(tmp_path / 'none.log')
    assert 'directory' in message_of(tmp_path)


def test_most_lines_damaged(write_log):
    """Two scans of five are left: one error, with the first fault and their number."""
    bad = FLASER.replace(' 1.25 ', ' here ')
    message = message_of(write_log(FLASER, bad, bad, bad, FLASER))
    assert 'line 2: x is' in message
    assert '3 of 5 lines cannot be used' in message
    # Odometry that is whole does not hide that most scans are not.
    assert 'line 2' in message_of(write_log(FLASER, bad, bad, *[ODOM] * 20))
    log = read_carmen(write_log(FLASER, bad, bad, FLASER))
    assert (log.damaged, len(log.scans)) == (2, 2)


@pytest.mark.parametrize('kept', [20, 300, 600])
def test_a_last_line_that_is_cut_costs_that_line(write_log, kept):
    path = write_log(FLASER, ODOM, FLASER)
    path.write_bytes(path.read_bytes() + FLASER.encode()[:kept])
    log = read_carmen(path)
    assert (len(log.records), log.damaged) == (3, 1)
    assert log.first_damage.startswith('line 4: FLASER line ends too early')


@pytest.mark.parametrize('end', ['\n', '\r\n', '\r'])
@pytest.mark.parametrize('longest', [4_000_000, 2000])
def test_any_line_ends(write_log, monkeypatch, end, longest):
    monkeypatch.setattr('ogm_mcmc.io.carmen.LONGEST_LINE', longest)
    path = write_log(FLASER)
    lines = [FLASER, ODOM, *[FLASER.replace(' 12.5 ', f' {20 + k} ') for k in range(9)], ODOM]
    path.write_bytes((end.join(lines) + end).encode())
    log = read_carmen(path)
    assert [scan.time_s for scan in log.scans] == [12.5, *range(20, 29)]
    assert (len(log.records), log.damaged) == (12, 0)


@pytest.mark.parametrize('end', ['\n', '\r\n', '\r'])
@pytest.mark.parametrize('length', [1999, 2000, 2001, 3999, 4000, 4001, 4002, 9000])
def test_a_line_that_is_too_long_costs_that_line(write_log, monkeypatch, end, length):
    monkeypatch.setattr('ogm_mcmc.io.carmen.LONGEST_LINE', 2000)
    path = write_log(FLASER)
    path.write_bytes(end.join([ODOM, 'X' * length, FLASER, ODOM, '']).encode())
    log = read_carmen(path)
    assert (len(log.records), log.damaged) == (3, int(length + len(end) > 2000))
    assert [scan.line for scan in log.scans] == [3]


@pytest.mark.parametrize(('time', 'n_scans'), [('12', 1), ('12.5', 2), ('12.5 host 1', 2)])
def test_a_last_time_that_lost_digits(write_log, time, n_scans):
    """`12` may be the rest of `12.75`: it would go before all others. Whole, it is a scan."""
    path = write_log(FLASER)
    path.write_bytes(path.read_bytes() + FLASER.replace('12.5 host 0.25', time).encode())
    log = read_carmen(path)
    assert (len(log.scans), log.damaged) == (n_scans, 2 - n_scans)


def test_last_particles_that_are_cut(write_log):
    """The last log-weight may have lost digits, so the last scan has no particles: left out."""
    path = write_log(LASER_READING, SM_UPDATE, LASER_READING, SM_UPDATE)
    path.write_bytes(path.read_bytes()[:-2])
    log = read_carmen(path)
    assert [scan.line for scan in log.scans] == [1]
    assert (log.damaged, log.without_particles) == (1, 1)


def test_particles_of_a_damaged_scan_go_to_no_other(write_log):
    other = SM_UPDATE.replace(' 1 2 0.5', ' 9 9 9')
    broken = LASER_READING.replace(' 0.5 ', ' ? ')
    log = read_carmen(write_log(LASER_READING, SM_UPDATE, broken, other, LASER_READING, other))
    assert [scan.particles.poses[0, 0] for scan in log.scans] == [1.0, 9.0]


@pytest.mark.parametrize(
    'remark', ['Zürich'.encode('latin-1'), 'Zürich'.encode(), b'\xff\x00\x85']
)
def test_bytes_that_are_not_ascii(tmp_path, remark):
    """In a remark, a parameter, a kind, a host, and a mark in front of it all."""
    scan = FLASER.encode().replace(b'host', remark)
    lines = [b'\xef\xbb\xbf' + scan, b'# ' + remark, b'PARAM robot_name ' + remark, remark, scan]
    path = tmp_path / 'small.log'
    path.write_bytes(b''.join(line + b'\n' for line in lines))
    log = read_carmen(path)
    assert [scan.time_s for scan in log.scans] == [12.5, 12.5]
    assert log.damaged == 0
    assert log.left_alone == {'unreadable': 1}


def test_a_reading_that_is_not_ascii(write_log):
    assert 'a range is no number' in fault_in_line_2(write_log, FLASER.replace(' 0.5 ', ' 0§5 '))


def test_a_line_without_end_costs_that_line_and_little_memory(write_log):
    plain = write_log(FLASER, FLASER).read_bytes()
    endless = b'FLASER ' + b'1 ' * 40_000_000
    path = write_log(FLASER)
    path.write_bytes(gzip.compress(plain + endless + b'\n' + plain, compresslevel=1))
    tracemalloc.start()
    log = read_carmen(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(log.scans) == 4
    assert log.damaged == 1
    assert 'line 3: the line: expected at most 4000000 bytes' in log.first_damage
    assert peak < 40e6
