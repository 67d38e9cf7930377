"""Sonar readings with known poses -> rosbag2, and where the sonars sit -> parameter file.

A Range message names its sensor's frame but not where that is. Readings of a whole ring go to one
topic, as the node subscribes to one; the parameter file says where the frames are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import yaml

from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagWriter
from ogm_mcmc.simulation import SonarRing

__all__ = ['write_sonar_parameters', 'write_sonar_recording']


def write_sonar_recording(
    path: Path,
    readings: Iterable[PlacedScan],
    mounts: Mapping[str, Pose2D],
    *,
    topic: str = '/range',
    overwrite: bool = False,
    into: Path | None = None,
) -> int:
    """Write `range` and the robot's known `pose` for each reading; return their number.

    `readings` are scans of one cone, placed where their sonar was; `mounts` say by frame where it
    sits on the robot. Readings of one stamp share a pose.
    """
    count, last_ns = 0, -1
    with BagWriter(path, overwrite=overwrite, into=into) as bag:
        for scan, belief in readings:
            stamp = scan.stamp_ns
            if stamp != last_ns:
                robot = belief.mean.compose(mounts[scan.frame_id].inverse())
                known = ros_types.pose_with_covariance(stamp, 'map', robot, np.zeros((3, 3)))
                bag.write('/pose', ros_types.POSE, stamp, known)
                last_ns = stamp
            message = ros_types.range_reading(
                stamp,
                scan.frame_id,
                float(scan.ranges_m[0]),
                field_of_view=scan.beam_width_rad,
                range_min=scan.range_min_m,
                range_max=scan.range_max_m,
            )
            bag.write(topic, ros_types.RANGE, stamp, message)
            count += 1
    return count


def write_sonar_parameters(path: Path, ring: SonarRing) -> None:
    """Write method and mounts as `--params-file` of `map` and of `online_mapper` takes them."""
    parameters = {'method': 'sonar', 'mount': {'frames': ring.mounts_setting()}}
    text = yaml.safe_dump({'/**': {'ros__parameters': parameters}}, width=10**6, sort_keys=False)
    with replacing(path) as temporary:
        temporary.write_text(
            f'# A simulated ring of {ring.sonars} sonars: the method for them, and where each\n'
            f'# sits on the robot (frame_id, x and y in m, yaw in rad).\n{text}',
            encoding='utf-8',
        )
