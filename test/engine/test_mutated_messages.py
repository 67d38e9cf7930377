"""Messages with fields changed at random, through reading, placing and every method.

Each is used, or dropped with one line; the map stays one of probabilities, and no message takes
long.
"""

import time
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from support.fuzz import ROUNDS, SEED

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory
from ogm_mcmc.errors import OgmError
from ogm_mcmc.io.messages import read_particles, read_pose, read_range, read_scan
from ogm_mcmc.mapping import METHODS
from ogm_mcmc.pipeline import MappingPipeline

NUMBERS = [0.0, -0.0, 1.0, -1.0, 5e-324, 1e-310, 1e-39, -1e-20, 1e-9, 0.05, 6.3, -7.0, 40.0, 1e4,
           1e6, 1e7, 1.1e7, -1e9, 3e38, -3e38, 1.7e308, np.nan, np.inf, -np.inf]  # fmt: skip
LONGEST_S = 10.0

CONFIGS = [
    MapperConfig(method=method, inverse_model=model, resolution=0.1, max_cells=4_000_000)
    for method in sorted(METHODS)
    for model in (('step', 'gaussian') if method in ('two_assumption', 'pose_uncertain') else
                  ('step',))
]  # fmt: skip


def header(number, frame):
    stamp = SimpleNamespace(sec=number // 10, nanosec=number % 10 * 100_000_000)
    return SimpleNamespace(stamp=stamp, frame_id=frame)


def pose_at(number):
    turned = SimpleNamespace(x=0.0, y=0.0, z=0.6, w=0.8)
    return SimpleNamespace(
        position=SimpleNamespace(x=0.01 * (number % 100), y=0.3, z=0.0), orientation=turned
    )


def pose_message(number):
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = 1e-4, 1e-4, 1e-5
    held = SimpleNamespace(pose=pose_at(number), covariance=covariance)
    return SimpleNamespace(header=header(number, 'map'), pose=held)


def particles_message(number):
    poses = [pose_at(number) for _ in range(3)]
    return SimpleNamespace(header=header(number, 'map'), poses=poses)


def scan_message(number):
    return SimpleNamespace(
        header=header(number, 'laser'),
        ranges=np.linspace(0.5, 3.0, 24, dtype=np.float32),
        angle_min=-1.5,
        angle_max=1.5,
        angle_increment=3.0 / 23,
        range_min=0.1,
        range_max=5.0,
        time_increment=0.0,
        scan_time=0.0,
    )


def range_message(number):
    return SimpleNamespace(
        header=header(number, 'laser'), range=1.5, min_range=0.1, max_range=4.0, field_of_view=0.4
    )


def places(message):
    """Every number in a message: (holder, name or index)."""
    found = []
    for name, value in vars(message).items():
        if isinstance(value, SimpleNamespace):
            found += places(value)
        elif isinstance(value, list):
            found += [place for one in value for place in places(one)]
        elif isinstance(value, np.ndarray):
            found += [(value, i) for i in range(len(value))]
        elif isinstance(value, float):
            found.append((message, name))
    return found


def change(message, rng):
    """Put odd numbers into one to three places; now and then another count or stamp."""
    for _ in range(rng.integers(1, 4)):
        every = places(message)
        holder, name = every[rng.integers(len(every))]
        value = NUMBERS[rng.integers(len(NUMBERS))]
        with np.errstate(over='ignore'):
            if not hasattr(message, 'pose'):  # scans hold numbers of 32 bits
                value = float(np.float32(value))
            if isinstance(holder, np.ndarray):
                holder[name] = value
            else:
                setattr(holder, name, value)
    if hasattr(message, 'ranges') and rng.random() < 0.1:
        message.ranges = np.resize(message.ranges, rng.choice([0, 1, 2, 5000]))
    if rng.random() < 0.05:
        message.header.stamp.sec = int(rng.choice([0, -(2**31), 2**31 - 1]))


def stamp_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def refusal(error):
    return 'refused' if str(error).splitlines() == [str(error)] else f'in lines: {error}'


def read(reader, message, outcomes):
    """Return what a reader makes of a message; None, and counted, where it refuses it."""
    try:
        return reader(message)
    except OgmError as error:
        outcomes[refusal(error)] += 1
        return None


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('config', CONFIGS, ids=[f'{c.method}-{c.inverse_model}' for c in CONFIGS])
def test_messages(config):
    rng = np.random.default_rng(SEED)
    outcomes = Counter()
    pipeline = MappingPipeline(config)
    placer = ScanPlacer(PoseHistory(), timeout_s=0.0)
    sonar = config.method == 'sonar'
    for number in range(ROUNDS):
        if number % 50 == 0:  # a reading from afar makes a large map: begin anew
            pipeline, placer = MappingPipeline(config), ScanPlacer(PoseHistory(), timeout_s=0.0)
        cloud = number % 3 == 0
        pose = particles_message(number) if cloud else pose_message(number)
        scan = range_message(number) if sonar else scan_message(number)
        for message, changed in ((pose, number % 2), (scan, number % 4 != 1)):
            if changed:
                change(message, rng)
        started = time.process_time()
        belief = read(read_particles if cloud else read_pose, pose, outcomes)
        if belief is not None:
            placer.add_pose(stamp_ns(pose), belief)
        taken = read(read_range if sonar else read_scan, scan, outcomes)
        if taken is not None:
            placer.add_scan(taken)
        for robot in placer.flush():
            try:
                box = pipeline.update(robot.on_mount())
            except OgmError as error:
                outcomes[refusal(error)] += 1
                continue
            shown = pipeline.method.probabilities(box)
            known = shown[~np.isnan(shown)]
            assert ((known >= 0.0) & (known <= 1.0)).all()
            outcomes['used'] += 1
        if number > 9:  # the first ones compile
            assert time.process_time() - started < LONGEST_S
    assert outcomes['used'] > ROUNDS // 10
    assert outcomes['refused'] > ROUNDS // 20
    assert set(outcomes) == {'used', 'refused'}
