"""Scans with known or believed poses -> rosbag2."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ogm_mcmc.geometry import PlacedScan, Scan
from ogm_mcmc.geometry.pose_sampling import systematic
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagWriter
from ogm_mcmc.simulation import DrivenScan, LocalizedScan

__all__ = ['write_drive', 'write_localized', 'write_recording', 'write_scan']


def write_recording(
    path: Path,
    scans: Iterable[PlacedScan],
    *,
    overwrite: bool = False,
    into: Path | None = None,
) -> int:
    """Write `scan` and `pose` (known, so of covariance zero); return the number of scans.

    path, overwrite, into  of `BagWriter`, also below
    """
    count = 0
    with BagWriter(path, overwrite=overwrite, into=into) as bag:
        for scan, belief in scans:
            stamp = scan.stamp_ns
            known = ros_types.pose_with_covariance(stamp, 'map', belief.mean, np.zeros((3, 3)))
            bag.write('/pose', ros_types.POSE, stamp, known)
            write_scan(bag, scan)
            count += 1
        bag.note_frame('/pose', 'laser')
    return count


def write_localized(
    path: Path,
    scans: Iterable[LocalizedScan],
    *,
    particles: int,
    overwrite: bool = False,
    into: Path | None = None,
) -> int:
    """Write `scan`, `pose` (mean and covariance), `particles` and `odom`; return how many scans.

    A PoseArray has no weights: it holds `particles` poses drawn from the belief.
    """
    count = 0
    with BagWriter(path, overwrite=overwrite, into=into) as bag:
        for (scan, belief), _, odometry in scans:
            stamp = scan.stamp_ns
            odom = ros_types.odometry(stamp, odometry, 0.0, 0.0)
            bag.write('/odom', ros_types.ODOMETRY, stamp, odom)
            assert belief.covariance is not None, 'a filter knows its covariance'
            assert belief.particles is not None, 'a filter has particles'
            mean = ros_types.pose_with_covariance(stamp, 'map', belief.mean, belief.covariance)
            bag.write('/pose', ros_types.POSE, stamp, mean)
            drawn = ros_types.pose_array(stamp, 'map', systematic(belief.particles, particles))
            bag.write('/particles', ros_types.PARTICLES, stamp, drawn)
            write_scan(bag, scan)
            count += 1
        for topic in ('/pose', '/particles'):
            bag.note_frame(topic, 'laser')
    return count


def write_drive(
    path: Path, scans: Iterable[DrivenScan], *, overwrite: bool = False, into: Path | None = None
) -> int:
    """Write `scan`, `odom`, `pose` and, where a loop closes, `trajectory`; return how many scans.

    Every message goes to the file as it comes: memory does not grow with the drive.
    """
    count = 0
    with BagWriter(path, overwrite=overwrite, into=into) as bag:
        for one in scans:
            stamp = one.scan.stamp_ns
            odom = ros_types.odometry(stamp, one.odometry, one.speed_m_s, one.turn_rad_s)
            bag.write('/odom', ros_types.ODOMETRY, stamp, odom)
            said = ros_types.pose_with_covariance(stamp, 'map', one.said, np.zeros((3, 3)))
            bag.write('/pose', ros_types.POSE, stamp, said)
            write_scan(bag, one.scan)
            if one.corrected is not None:
                corrected = ros_types.path(stamp, 'map', *one.corrected)
                bag.write('/trajectory', ros_types.PATH, stamp, corrected)
            count += 1
        bag.note_frame('/pose', 'laser')
    return count


def write_scan(bag: BagWriter, scan: Scan) -> None:
    """Append a scan as LaserScan on `/scan`."""
    message = ros_types.laser_scan(
        scan.stamp_ns,
        scan.frame_id,
        scan.ranges_m,
        angle_min=scan.angle_min_rad,
        angle_increment=scan.angle_increment_rad,
        range_min=scan.range_min_m,
        range_max=scan.range_max_m,
    )
    bag.write('/scan', ros_types.SCAN, scan.stamp_ns, message)
