"""The walk visits the cells of the exact traversal, corners included, at the right distances."""

import math

from hypothesis import given
from hypothesis import strategies as st
from support.naive import corner_margin, crossed_cells
from support.strategies import REPEATABLE, dyadics

from ogm_mcmc.geometry.walk_kernels import begin_walk, next_cell

# With steps of powers of two the kernels' arithmetic is exact: corners are met exactly.
exact_steps = st.one_of(
    st.just(0.0), st.builds(lambda k, s: s * 2.0**k, st.integers(-3, 3), st.sampled_from([-1, 1]))
)


def walked(x, y, dx, dy, reach):
    """Cells and the distances at which they are entered, up to `reach` times the vector."""
    next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(x, y, dx, dy)
    at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
    column, row, entered = math.floor(x), math.floor(y), 0.0
    cells, distances = [], []
    while entered <= reach:
        cells.append((column, row))
        distances.append(entered)
        entered = min(at_x, at_y)
        column, row, next_x, next_y, at_x, at_y = next_cell(
            x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y, at_x, at_y
        )
    return cells, distances


@REPEATABLE
@given(x=dyadics(-3, 3), y=dyadics(-3, 3), dx=exact_steps, dy=exact_steps)
def test_exact_walks(x, y, dx, dy):
    if dx == dy == 0.0:
        return
    cells, distances = walked(x, y, dx, dy, 1.0)
    expected = crossed_cells(x, y, x + dx, y + dy)
    # A walk to the left or down enters a cell at its far border, which belongs to the one before.
    while cells[-1] not in expected:
        assert distances[-1] == 1.0
        cells.pop()
    assert cells == expected


@REPEATABLE
@given(
    x=st.floats(0.0, 1.0, exclude_max=True),
    y=st.floats(0.0, 1.0, exclude_max=True),
    angle=st.floats(-math.pi, math.pi),
)
def test_walks_at_any_angle(x, y, angle):
    reach = 40.0
    dx, dy = math.cos(angle), math.sin(angle)
    end = (x + reach * dx, y + reach * dy)
    if corner_margin(x, y, *end) < 1e-9:
        return
    cells, distances = walked(x, y, dx, dy, reach)
    assert cells == crossed_cells(x, y, *end)
    for (column, row), entered in zip(cells[1:], distances[1:], strict=True):
        at = (x + entered * dx - column, y + entered * dy - row)
        assert min(abs(side - edge) for side in at for edge in (0.0, 1.0)) < 1e-9
    assert distances == sorted(distances)
