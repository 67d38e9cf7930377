"""What travels to workers is what was there."""

from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.geometry.pose import PoseBelief
from ogm_mcmc.lab.parcels import pack, unpack


def scans_of_all_kinds():
    belief = PoseBelief(Pose2D(1.0, -2.0, 0.5), np.eye(3) * 0.01)
    bent = replace(fan(1.25, 2.0), bearings_rad=np.array([0.1, 0.25]), stamp_ns=7)
    return [
        PlacedScan(fan(0.1, np.inf, -np.inf, np.nan), belief),
        PlacedScan.at(bent, Pose2D(3.0, 4.0, -1.0)),
    ]


@pytest.mark.parametrize('count', [0, 1, 2])
def test_scans_arrive_as_they_were_but_for_doubt_of_poses(count):
    sent = scans_of_all_kinds()[:count]
    arrived, other = unpack(pack(sent, {'also': 3}))
    assert other == {'also': 3}
    assert len(arrived) == count
    for here, there in zip(sent, arrived, strict=True):
        assert np.array_equal(
            here.scan.ranges_m.view(np.uint32), there.scan.ranges_m.view(np.uint32)
        )
        assert there.scan.ranges_m.flags.writeable
        assert there.scan.ranges_m.base is None
        assert there.belief == PoseBelief(here.pose)
        assert there.scan.range_max_m == here.scan.range_max_m
    if count == 2:
        assert np.array_equal(arrived[1].scan.bearings_rad, sent[1].scan.bearings_rad)
        assert arrived[1].scan.stamp_ns == 7


def test_many_readings_take_less_than_they_do_here():
    ranges = np.random.default_rng(0).normal(5.0, 0.01, 4000).round(3)
    parcel = pack([PlacedScan.at(fan(*ranges), Pose2D())], None)
    assert len(parcel) < 3 * ranges.size
