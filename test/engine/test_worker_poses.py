"""The worker where poses are refined, too."""

from dataclasses import replace

import numpy as np
import pytest
from support.rooms import ROOM, noisy_drive
from support.workers import CONFIG, until

from ogm_mcmc.config import PosesConfig, StopConfig, TrajectoryConfig
from ogm_mcmc.config.nodes import NodeModelConfig
from ogm_mcmc.engine.sensor_fit import fit_sensor
from ogm_mcmc.evaluation import confusion_counts
from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.trajectory.points import xyyaw

# What has a deadline here is compiled before the clock runs.
pytestmark = pytest.mark.usefixtures('compiled')


def wall_f1(result):
    """Best F1 of a map, walls being the cells that one runs through."""
    spec = result.grid_map.spec
    x = spec.origin_x_m - 0.05 + (np.arange(spec.width) + 0.5) * spec.resolution_m
    y = (spec.origin_y_m - 0.05 + (np.arange(spec.height) + 0.5) * spec.resolution_m)[:, None]
    nearest = np.full((spec.height, spec.width), np.inf)
    for ax, ay, bx, by in ROOM:
        dx, dy = bx - ax, by - ay
        along = np.clip(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - ax - along * dx, y - ay - along * dy))
    walls = nearest <= 0.45 * spec.resolution_m
    inside = (x > -0.3) & (x < 6.3) & (y > -0.3) & (y < 4.3)
    probability = np.nan_to_num(result.grid_map.probability, nan=0.0)[inside]
    return confusion_counts(probability, walls[inside]).best().f1


def test_joint_poses_make_a_better_map_within_the_deadline(make):
    truth, placed = noisy_drive()
    limits, found, sensor = StopConfig(max_sweeps=60, max_time=30.0, r_hat=0.0), {}, {}
    chain = replace(CONFIG.chain, sensor='fitted')
    config = replace(CONFIG, model=NodeModelConfig(), chain=chain)
    for poses in ('fixed', 'joint'):
        settings = PosesConfig(poses, TrajectoryConfig(draws=10))
        worker = make(config=config, poses=settings, map_every_s=100.0)
        worker.refine(placed, limits)
        until(lambda worker=worker: worker.status.state == 'idle' and worker.result, 60.0)
        found[poses] = worker.result
        assert worker.status.stopped == 'sweeps'
        sensor[poses] = worker.status.sensor
    # What the beams are like is found at the poses of the end, not at those they came with.
    assert sensor['fixed'] == fit_sensor(placed, config)[1]
    assert sensor['joint'] == fit_sensor(worker._poses.placed(placed), config)[1]
    assert sensor['joint'].sigma.high_95 < sensor['fixed'].sigma.low_95
    low, spread, high = found['joint'].trajectory.points
    assert 0.0 < low < spread < high < 0.05
    assert found['fixed'].trajectory is None
    trajectory = found['joint'].trajectory
    poses = xyyaw([belief.mean for belief in trajectory.beliefs])
    assert absolute_errors(poses, truth).distance_m.mean() < 0.01
    assert trajectory.stamps_ns == list(range(1, 17))
    moved = trajectory.correction.compose(placed[-1].pose)
    assert moved.x_m == pytest.approx(trajectory.beliefs[-1].mean.x_m)
    assert wall_f1(found['joint']) > wall_f1(found['fixed']) + 0.04
