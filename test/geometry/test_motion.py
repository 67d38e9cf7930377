import math

import pytest

from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.geometry.motion import SLACK_M, jumps

S = 1_000_000_000


@pytest.mark.parametrize(
    ('later', 'apart_ns', 'expected'),
    [
        (Pose2D(9.0, 0.0, 0.0), S, False),
        (Pose2D(6.0, 8.2, 0.0), S, True),  # 10.16 m
        (Pose2D(0.0, 0.02, 0.0), 1, False),  # stamps a nanosecond apart
        (Pose2D(0.0, SLACK_M + 0.01, 0.0), 1, True),
        (Pose2D(0.0, 0.0, 1.2), S // 10, True),
        (Pose2D(0.0, 0.0, 1.0), S // 10, False),
        (Pose2D(0.0, 0.0, 2 * math.pi - 0.05), 1, False),
    ],
)
def test_jumps(later, apart_ns, expected):
    assert jumps(Pose2D(), later, apart_ns) is expected
    assert jumps(later, Pose2D(), apart_ns) is expected
