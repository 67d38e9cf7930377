"""The recorded logs of section 6 of the design: what they hold, after the way through a bag."""

import gzip
import itertools

import numpy as np
import pytest

from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen

SECOND = 1_000_000_000

pytestmark = pytest.mark.data


@pytest.fixture
def convert(data_folder, tmp_path, read_bag):
    """Import a recorded log: (summary, bag)."""

    def run(name, **options):
        summary = import_carmen(data_folder / name, tmp_path / 'bag', ImportOptions(**options))
        return summary, read_bag(tmp_path / 'bag')

    return run


@pytest.fixture
def lines_of(data_folder):
    """Words of a log's lines of one kind, read without the package."""

    def read(name, kind):
        path = data_folder / name
        text = gzip.decompress(path.read_bytes()) if path.suffix == '.gz' else path.read_bytes()
        return [line.split() for line in text.decode().splitlines() if line.split()[0] == kind]

    return read


def check_scans(bag, n_scans, n_beams, degrees, no_return):
    scans = [message for _, message in bag.topics['/scan']]
    assert len(scans) == len(bag.topics['/pose']) == n_scans
    assert {scan.ranges.size for scan in scans} == {n_beams}
    assert sum(int(np.isposinf(scan.ranges).sum()) for scan in scans) == no_return
    for scan in scans:
        assert np.degrees(scan.angle_increment) == pytest.approx(degrees, rel=1e-6)
        assert np.degrees(scan.angle_min) == pytest.approx(-90.0, rel=1e-6)
        assert scan.range_max == 80.0
        finite = scan.ranges[np.isfinite(scan.ranges)]
        assert (finite <= scan.range_max).all()
    for topic, messages in bag.topics.items():
        times = np.array([time for time, _ in messages])
        assert (np.diff(times) > 0).all(), topic
        header = [m.header.stamp.sec * SECOND + m.header.stamp.nanosec for _, m in messages]
        assert header == times.tolist()
    return scans


def test_intel(convert, lines_of):
    name = 'intel/intel.gfs.log'
    summary, bag = convert(name)
    lines = lines_of(name, 'FLASER')
    codes = sum(float(word) >= 81.8 for words in lines for word in words[2:182])
    assert codes == summary.no_return == 4172
    scans = check_scans(bag, 910, 180, 1.0, 4172)
    # Four neighbouring pairs are the wrong way round in the file.
    times = [float(words[188]) for words in lines]
    late = sum(after < before for before, after in itertools.pairwise(times))
    assert late == summary.out_of_order['front'] == 4
    order = np.argsort(times, kind='stable')
    assert order.tolist() != list(range(910))
    for index, scan, (_, pose) in zip(order, scans, bag.topics['/pose'], strict=True):
        words = lines[index]
        expected = [float(word) for word in words[2:182]]
        returned = np.isfinite(scan.ranges)
        assert scan.ranges[returned] == pytest.approx(np.array(expected)[returned], rel=1e-6)
        assert pose.pose.pose.position.x == float(words[182])
        assert pose.pose.pose.position.y == float(words[183])
    assert len(bag.topics['/odom']) == summary.odometry
    assert summary.odometry + summary.odometry_echoes == len(lines_of(name, 'ODOM')) == 14541
    assert summary.odometry_echoes == 910


def test_csail(convert, data_folder):
    summary, bag = convert('csail/csail.corrected.gfs')
    check_scans(bag, 406, 361, 0.5, summary.no_return)
    assert summary.particles_per_scan == 30
    assert {len(message.poses) for _, message in bag.topics['/particles']} == {30}
    assert not summary.out_of_order
    scans = read_carmen(data_folder / 'csail/csail.corrected.gfs').scans
    assert len(scans) == 406
    for scan, (_, pose) in zip(scans, bag.topics['/pose'], strict=True):
        poses, weights = scan.particles
        assert poses.shape == (30, 3)
        assert weights.sum() == pytest.approx(1.0)
        assert (weights >= 0.0).all()
        covariance = pose.pose.covariance.reshape(6, 6)
        assert covariance == pytest.approx(covariance.T, abs=1e-15)
        assert np.linalg.eigvalsh(covariance)[0] >= -1e-12
        assert pose.pose.pose.position.x == pytest.approx(weights @ poses[:, 0])
        spread = np.cov(poses[:, :2].T, aweights=weights, bias=True)
        assert covariance[:2, :2] == pytest.approx(spread, abs=1e-12)


def test_csail_weights(data_folder, lines_of):
    """From the words of the first update: exp((lw - max lw) / 90), normalised."""
    words = lines_of('csail/csail.corrected.gfs', 'SM_UPDATE')[200]
    log_weights = np.array(words[2:], float).reshape(30, 4)[:, 3]
    expected = np.exp((log_weights - log_weights.max()) / 90.0)
    scan = read_carmen(data_folder / 'csail/csail.corrected.gfs').scans[200]
    assert np.ptp(log_weights) > 0.0
    assert scan.particles.weights == pytest.approx(expected / expected.sum())


def test_belgioioso(convert, lines_of):
    """Stamps of six digits: nearly all repeat, and the order of the file is all there is."""
    name = 'carmen/belgioioso-corrected.log.gz'
    summary, bag = convert(name)
    lines = lines_of(name, 'FLASER')
    times = [float(words[369]) for words in lines]
    assert len(set(times)) < 10
    assert summary.repeated_stamps > 4000
    check_scans(bag, 395, 361, 0.5, summary.no_return)
    in_file = [(float(words[363]), float(words[364])) for words in lines]
    positions = [message.pose.pose.position for _, message in bag.topics['/pose']]
    assert [(p.x, p.y) for p in positions] == in_file
    assert not summary.out_of_order


def test_freiburg_101(convert, lines_of):
    name = 'carmen/freiburg-101-corrected.log.gz'
    summary, bag = convert(name)
    codes = [float(w) for words in lines_of(name, 'FLASER') for w in words[2:362]]
    assert summary.no_return == sum(code >= 81.8 for code in codes)
    check_scans(bag, 292, 360, 0.5, summary.no_return)
    assert (summary.repeated_stamps, summary.out_of_order) == (0, {})
