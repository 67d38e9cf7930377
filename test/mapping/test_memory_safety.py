"""Where a kernel might write beside its arrays: each case in a process of its own.

A compiled kernel checks no index, so what goes wrong here may end the process or spoil another
cell in silence. Every case compares the changed cells with the box that `update` returned.
"""

import subprocess
import sys
from textwrap import dedent

import pytest

COMMON = """
    import math
    import sys
    import numpy as np
    from ogm_mcmc.config import MapperConfig
    from ogm_mcmc.errors import GridError
    from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief
    from ogm_mcmc.mapping import make_method
    from support.strategies import fan

    def belief(pose):
        # A pose known, or to within less than any rounding.
        return PoseBelief(pose, np.diag(spread) if any(spread) else None)

    def low_high(cells):
        # How many cells a row may have: clouds and what lies behind a wall touch more.
        simple = not any(spread) and chosen.get('inverse_model') != 'gaussian'
        return range(cells, cells + 2 if simple else 3 * cells)

    def check(method, box):
        measured = ~np.isnan(method.probabilities(method.spec.box))
        inside = measured[method.spec.slices(box)]
        assert measured.sum() == inside.sum(), 'cells outside of the returned box'
        assert not method.grid.free_bits.any(), 'marks left behind'
        return inside
"""

CASES = {
    # A robot before its first move with a lidar that sees nothing behind it: cell (0, 0) is the
    # leftmost, and beams a little to the right are walked up to exactly its corner.
    'forward lidar at the origin': """
        rng = np.random.default_rng(0)
        for _ in range(100):
            method = make_method(MapperConfig(**chosen, resolution=1.0))
            scan = fan(*rng.uniform(10.0, 20.0, 180), bearing=-0.05, increment=0.05 / 180)
            check(method, method.update(PlacedScan(scan, belief(Pose2D()))))
    """,
    # x - floor(x) is 1.0 for the tiniest negative numbers: a robot that looks back, or down.
    'hardly below the origin': """
        for x, y, yaw in ((-1e-20, 0.51, math.pi), (0.51, -1e-20, -math.pi / 2)):
            method = make_method(MapperConfig(**chosen, resolution=1.0))
            inside = check(method, method.update(PlacedScan(fan(5.5), belief(Pose2D(x, y, yaw)))))
            assert inside.sum() in low_high(6)  # the cell above the border may count
    """,
    # A slope of 100 cells in 1e-307 is no float any more.
    'hardly turned': """
        for yaw in (-1e-300, -1e-307, -1e-309, -5e-324, 5e-324):
            method = make_method(MapperConfig(**chosen, resolution=0.05))
            placed = PlacedScan(fan(5.0), belief(Pose2D(0.025, 0.0, yaw)))
            inside = check(method, method.update(placed))
            assert inside.sum() in low_high(101)
    """,
    # 34 million cells are allowed by default, also as 64 rows of half a million columns.
    'a very wide map': """
        method = make_method(MapperConfig(**chosen, resolution=1.0))
        method.update(PlacedScan(fan(5.0), belief(Pose2D(0.5, 0.5))))
        far = 2.0**19 + 100.5
        try:
            box = method.update(PlacedScan(fan(5.0), belief(Pose2D(far, 0.5))))
        except GridError:
            pass  # to refuse is safe, too
        else:
            shown = method.probabilities(box)
            shown = shown[~np.isnan(shown)].tolist()
            assert len(shown) in low_high(6)
            assert max(shown[:5]) < 0.5
            assert shown[5] > 0.5
    """,
}


# How each method is told, and how uncertain the poses are.
METHODS = {
    'two_assumption': ({'method': 'two_assumption'}, (0.0, 0.0, 0.0)),
    'gaussian': ({'method': 'two_assumption', 'inverse_model': 'gaussian'}, (0.0, 0.0, 0.0)),
    'pose_uncertain': ({'method': 'pose_uncertain'}, (1e-40, 1e-12, 1e-30)),
    'pose_uncertain, gaussian': (
        {'method': 'pose_uncertain', 'inverse_model': 'gaussian'},
        (1e-40, 1e-12, 1e-30),
    ),
    'counting': ({'method': 'counting'}, (0.0, 0.0, 0.0)),
}


@pytest.mark.jit
@pytest.mark.parametrize('fusion', ['per_scan', 'per_beam'])
@pytest.mark.parametrize('name', CASES)
def test_no_cell_is_written_outside_of_the_box(name, fusion, repository):
    """One method after the other; the last one named is at fault."""
    program = dedent(COMMON)
    for method, (chosen, spread) in METHODS.items():
        program += f'chosen, spread = {dict(chosen, fusion=fusion)!r}, {spread!r}\n'
        program += f'print({method!r}, file=sys.stderr, flush=True)\n{dedent(CASES[name])}\n'
    done = subprocess.run(
        [sys.executable, '-c', program],
        cwd=repository,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, f'exit code {done.returncode}: {done.stderr[-600:]}'
