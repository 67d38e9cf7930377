"""Hypothesis strategies for segments, poses and scans, and scans made by hand.

Dyadic coordinates (whole numbers of 1/2**bits) make sums and differences of floats exact.
"""

from __future__ import annotations

import math

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from ogm_mcmc.geometry import Pose2D, Scan

__all__ = [
    'REPEATABLE',
    'Segment',
    'dyadics',
    'exact_slope_segments',
    'fan',
    'float_segments',
    'poses',
    'scans',
    'segments',
    'stamps_ns',
    'touchy_segments',
]

REPEATABLE = settings(derandomize=True, deadline=None, max_examples=150)
"""The same examples in every run; kernels may have to be compiled within one."""

Segment = tuple[float, float, float, float]
"""x0, y0, x1, y1 in cells."""


def dyadics(low: int, high: int, bits: int = 4) -> st.SearchStrategy[float]:
    """Whole numbers of 1/2**bits from low to high."""
    return st.integers(low << bits, high << bits).map(lambda k: k / 2**bits)


def segments(reach: int = 20, bits: int = 4) -> st.SearchStrategy[Segment]:
    """Segments with dyadic ends in a square of plus and minus `reach` cells."""
    value = dyadics(-reach, reach, bits)
    return st.tuples(value, value, value, value)


@st.composite
def exact_slope_segments(draw: st.DrawFn, reach: int = 16, bits: int = 4) -> Segment:
    """Dyadic segments whose slope dx/dy is dyadic as well: every step of a walk is exact.

    Their height is 0 or a power of two, so they pass through corners often.
    """
    value = dyadics(-reach, reach, bits)
    x0, y0, x1 = draw(value), draw(value), draw(value)
    height = draw(st.sampled_from([0.0] + [2.0**k for k in range(-bits, 5)]))
    return x0, y0, x1, y0 + draw(st.sampled_from([-height, height]))


@st.composite
def float_segments(draw: st.DrawFn, reach: float = 400.0) -> Segment:
    """Segments as beams make them: from a point in cell (0, 0), often its corner, at any angle."""
    start = st.one_of(st.just(0.0), st.floats(0.0, 1.0, exclude_max=True))
    x, y = draw(start), draw(start)
    angle = draw(st.floats(-math.pi, math.pi))
    length = draw(st.floats(0.0, reach))
    # Flatter ones, whose slope is no float, are left to `test_memory_safety`.
    rise = length * math.sin(angle)
    return x, y, x + length * math.cos(angle), y + (rise if abs(rise) > 1e-250 else 0.0)


@st.composite
def touchy_segments(draw: st.DrawFn) -> Segment:
    """Segments with ends on the lines of the lattice or by less than a rounding error beside.

    They begin in cell (0, 0), as those of a sensor do.
    """
    error = st.sampled_from([0.0, 2.0**-54, 2.0**-53, 2.0**-44, 2.0**-40, 1.1 * 2.0**-39])
    start = st.one_of(error, error.map(lambda e: math.nextafter(1.0, 0.0) - e), dyadics(0, 1, 8))
    signed = st.one_of(error, error.map(lambda e: -e))
    end = st.one_of(
        st.builds(lambda k, e: k + e, st.integers(-8, 8), signed), dyadics(-8, 8), st.just(300.0)
    )
    return draw(start) % 1.0, draw(start) % 1.0, draw(end), draw(end)


def fan(
    *ranges_m: float,
    bearing: float = 0.0,
    increment: float = 2.0 * math.pi,
    range_max_m: float = 20.0,
    stamp_ns: int = 0,
    frame_id: str = '',
) -> Scan:
    """Scan with a beam for each range; unless told otherwise all of them look straight ahead."""
    return Scan.checked(
        np.array(ranges_m),
        angle_min_rad=bearing,
        angle_increment_rad=increment,
        range_min_m=0.0,
        range_max_m=range_max_m,
        stamp_ns=stamp_ns,
        frame_id=frame_id,
    )


def poses(reach_m: float = 20.0) -> st.SearchStrategy[Pose2D]:
    """Poses within plus and minus `reach_m`, at any heading."""
    place = st.floats(-reach_m, reach_m)
    return st.builds(Pose2D, place, place, st.floats(-math.pi, math.pi, exclude_max=True))


@st.composite
def scans(draw: st.DrawFn, max_beams: int = 12, range_max_m: float = 6.0) -> Scan:
    """Scans with ordinary readings among every kind of reading that REP 117 knows."""
    reading = st.one_of(
        st.floats(0.0625, range_max_m, width=32),
        st.sampled_from([math.inf, -math.inf, math.nan, 0.0, -1.0, 1e-3, range_max_m + 1.0]),
    )
    ranges = draw(st.lists(reading, min_size=1, max_size=max_beams))
    return Scan.checked(
        np.array(ranges),
        angle_min_rad=draw(st.floats(-math.pi, math.pi)),
        angle_increment_rad=draw(st.sampled_from([-0.7, -0.05, 0.01, 0.3, 1.1])),
        range_min_m=draw(st.sampled_from([0.0, 0.1])),
        range_max_m=range_max_m,
    )


def stamps_ns(last_s: float = 10.0) -> st.SearchStrategy[int]:
    """Stamps in nanoseconds from 0 on."""
    return st.integers(0, round(last_s * 1e9))
