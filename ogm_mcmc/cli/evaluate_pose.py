"""`evaluate MAP --pose X,Y,YAW`: what the map does not know, and what a scan would tell."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from tqdm import tqdm

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.cli.evaluate_answer import Answer
from ogm_mcmc.config import ExpectedScanConfig, ForwardModelConfig, flatten
from ogm_mcmc.errors import PoseError
from ogm_mcmc.evaluation import ForwardModel, entropy_nats, expected_information_gain
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.plotting import Picture, Series, curves_png
from ogm_mcmc.simulation import Lidar

__all__ = ['from_pose', 'pose_inside', 'read_pose']

# So many beams at a time, between two looks at the bar.
PART = 8


def read_pose(text: str) -> Pose2D:
    """Read X,Y,YAW. Raises PoseError."""
    try:
        x, y, yaw = map(float, text.split(','))
        return Pose2D(x, y, yaw)
    except ValueError as error:
        raise PoseError(f'--pose is {text!r}: expected X,Y,YAW (m, m, rad)') from error


def pose_inside(pose: Pose2D, grid_map: GridMap) -> Pose2D:
    """Return a pose that lies on the map. Raises PoseError for another."""
    spec = grid_map.spec
    column, row = spec.cell_of(pose.x_m, pose.y_m)
    if 0 <= column < spec.width and 0 <= row < spec.height:
        return pose
    right = spec.origin_x_m + spec.width * spec.resolution_m
    top = spec.origin_y_m + spec.height * spec.resolution_m
    raise PoseError(
        f'pose ({pose.x_m:g}, {pose.y_m:g}) lies outside of the map: expected x from '
        f'{spec.origin_x_m:g} to {right:g}, y from {spec.origin_y_m:g} to {top:g}'
    )


def from_pose(
    grid_map: GridMap,
    pose: Pose2D,
    unknown: float,
    expected: ExpectedScanConfig,
    model: ForwardModelConfig,
) -> Answer:
    """Say how uncertain a map is, and what a scan of a lidar is expected to tell about it."""
    lidar = Lidar(
        expected.lidar_beams,
        0.0,
        expected.lidar_range_max,
        field_of_view_rad=math.radians(expected.lidar_field_of_view),
    )
    bearings = lidar.bearings()
    gains = np.empty(bearings.size)
    judge = ForwardModel.from_config(model)
    with tqdm(total=gains.size, unit=' beams', desc='expect', disable=None) as bar:
        for first in range(0, gains.size, PART):
            part = slice(first, first + PART)
            gains[part] = expected_information_gain(
                grid_map, pose, bearings[part], lidar.range_max_m, judge, prior=unknown
            )
            bar.update(gains[part].size)
    figures = {'pose': [pose.x_m, pose.y_m, pose.yaw_rad], **_figures(grid_map, unknown, gains)}
    settings = {
        **{f'model.{name}': value for name, value in flatten(model).items()},
        **flatten(expected),
    }
    caption = 'Information that each beam of a scan from the pose is expected to give'
    curve = Series('', np.degrees(bearings), gains)
    picture = Picture(curves_png([curve], 'bearing, degrees', 'nats'), caption)
    return Answer(figures, _rows(figures), [('A scan that may come', [picture])], settings)


def _figures(grid_map: GridMap, unknown: float, gains: Float64Array) -> dict[str, Any]:
    entropy = entropy_nats(grid_map.probability)
    measured = np.isfinite(entropy)
    known, missing = float(entropy[measured].sum()), int((~measured).sum())
    doubt = float(entropy_nats(np.array([unknown]))[0])
    return {
        'measured_cells': int(measured.sum()),
        'unknown_cells': missing,
        'entropy_measured_nats': known,
        'entropy_nats': known + missing * doubt,
        'information_gain_nats': float(gains.sum()),
        'information_gain_per_beam': float(gains.mean()),
        'information_gain_of_beams': gains.tolist(),
    }


def _rows(of: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the figures as name and value, for people."""
    x, y, yaw = of['pose']
    return [
        (
            'entropy of the map, nats',
            f'{of["entropy_nats"]:.6g} ({of["unknown_cells"]} cells unknown)',
        ),
        (
            '  of its measured cells',
            f'{of["entropy_measured_nats"]:.6g} ({of["measured_cells"]} cells)',
        ),
        (f'scan from {x:g}, {y:g}, {yaw:g}', f'at most {of["information_gain_nats"]:.5g} nats'),
        ('  expected of a beam', f'{of["information_gain_per_beam"]:.4g}'),
    ]
