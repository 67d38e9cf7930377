"""Shared fixtures: where the recorded logs are, a small bag, an isolated ROS."""

import itertools
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.domains import domain_of
from support.kernel_caches import forget_stale_kernels
from support.office import EVERY, OFFICE_SCANS

ROOT = Path(__file__).resolve().parents[1]

# Markers of files that take long.
LONGEST_FIRST = ('slow', 'ros')

pytest_plugins = ['support.bag_fixtures']


@pytest.fixture(scope='session')
def repository() -> Path:
    return ROOT


@pytest.fixture(scope='session')
def data_folder() -> Path:
    """The recorded logs; the test is skipped where they are not."""
    folder = Path(os.environ.get('OGM_MCMC_DATA', ROOT.parent / 'shared' / 'data'))
    if not folder.is_dir():
        pytest.skip(f'recorded logs are not in {folder} (set OGM_MCMC_DATA)')
    return folder


@pytest.fixture(scope='session')
def office_bag(tmp_path_factory) -> Path:
    """A simulated walk: OFFICE_SCANS scans of 90 beams with known poses."""
    from ogm_mcmc.io.recording_bag import write_recording
    from ogm_mcmc.simulation import WORLDS, Lidar, record

    path = tmp_path_factory.mktemp('bags') / 'office'
    walk = record(WORLDS['office'](), Lidar(beams=90), np.random.default_rng(5))
    write_recording(path, itertools.islice(walk, 0, EVERY * OFFICE_SCANS, EVERY))
    return path


@pytest.fixture
def run_cli(tmp_path, monkeypatch):
    """Run a command in the test's own process, in a folder of its own, as `run_process` does.

    A process costs two seconds of imports. What a command does not catch fails the test.
    """
    from support.commands import finished

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        return finished(*arguments)

    return run


@pytest.fixture
def run_process(tmp_path):
    """Run `python3 -m ogm_mcmc ...` as a user does; returns the finished process."""

    def run(*arguments, timeout=120, **environment):
        return subprocess.run(
            [sys.executable, '-m', 'ogm_mcmc', *map(str, arguments)],
            cwd=tmp_path,
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            timeout=timeout,
        )

    return run


def pytest_configure(config) -> None:
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        # A shell without job control has it ignored in the background, and children inherit that.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    worker = os.environ.get('PYTEST_XDIST_WORKER')
    if worker is None:
        forget_stale_kernels()
    # Processes that tests start find their support, too.
    paths = [str(ROOT / 'test'), os.environ.get('PYTHONPATH', '')]
    os.environ['PYTHONPATH'] = os.pathsep.join(filter(None, paths))
    # Before rclpy is first imported: a domain for each worker, on this machine only.
    if worker is not None:
        number = int(worker.removeprefix('gw'))
        os.environ['ROS_DOMAIN_ID'] = str(domain_of(int(os.environ['ROS_DOMAIN_ID']), number))
    os.environ.setdefault('ROS_DOMAIN_ID', str(20 + os.getpid() % 80))
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_LOG_DIR', str(Path(os.environ.get('TMPDIR', '/tmp')) / 'ogm_ros'))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Return the workers of `-n auto`: one more than cores, as tests of nodes wait a lot."""
    return len(os.sched_getaffinity(0)) + 1


def pytest_collection_modifyitems(items) -> None:
    """For workers: files that take long come first, so that the last ones handed out are short."""
    if 'PYTEST_XDIST_WORKER' not in os.environ:
        return
    ranks = {item.path: len(LONGEST_FIRST) for item in items}
    for item in items:
        marks = [item.get_closest_marker(name) is not None for name in LONGEST_FIRST]
        ranks[item.path] = min(ranks[item.path], (*marks, True).index(True))
    items.sort(key=lambda item: ranks[item.path])
