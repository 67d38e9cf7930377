"""How beams graze what they hit: the slant of surfaces, by the readings beside each other."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.geometry.scan import Scan
from ogm_mcmc.geometry.slant_kernels import fill_slants

__all__ = ['slants_of']


def slants_of(scan: Scan, stretch_m: float) -> Float64Array:
    """Return (B,) by how much ranges grow as a surface moves across itself by one: 1 / tan(angle).

    The angle is that between beam and surface: 0 where it is met square, 5.7 at ten degrees. The
    surface is the line through readings `stretch_m` to either side, or a beam where beams are
    further apart, if the one in the middle lies on it; of three such lines (this reading at an
    end, or in the middle) the one that is grazed least, so that at corners and steps nothing is
    made up. 0, too, where readings do not tell: alone, without a return (outside the limits of the
    sensor, `Scan.measured`), or beside gaps.
    """
    slants = np.zeros(scan.ranges_m.size)
    ranges = np.where(scan.measured(), scan.ranges_m, np.float32(np.nan))
    fill_slants(ranges, scan.directions(), stretch_m, slants)
    return slants
