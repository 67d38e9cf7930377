"""Scans of one beam, and a placer of them."""

from ogm_mcmc.engine.placing import ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory
from ogm_mcmc.geometry import Pose2D, PoseBelief
from support.strategies import fan

__all__ = ['S', 'belief', 'placed', 'placer_with', 'scan']


S = 1_000_000_000


def scan(stamp_s, frame_id='laser'):
    """Return a scan of one beam."""
    return fan(1.0, stamp_ns=round(stamp_s * S), frame_id=frame_id)


def belief(x=0.0, yaw=0.0):
    """Return a pose on the falling diagonal."""
    return PoseBelief(Pose2D(x, -x, yaw))


def placer_with(*poses, **options):
    """Return a placer that knows the poses (stamp in s, belief), and what it drops from now on."""
    dropped = []
    placer = ScanPlacer(
        PoseHistory(max_gap_s=options.pop('max_gap_s', 2.0)),
        on_drop=lambda reason, what: dropped.append((reason, what)),
        **options,
    )
    for stamp_s, pose in poses:
        placer.add_pose(round(stamp_s * S), pose)
    return placer, dropped


def placed(placer, now_s=0.0):
    """Stamp in s and x of every scan placed now."""
    return [(p.scan.stamp_ns / S, p.belief.mean.x_m) for p in placer.placed(now_s)]
