"""Grids as figures: cells with axes, a colour bar, marks and close-ups, made by matplotlib.

Every cell has the same whole number of pixels, so none is lost or blurred, and the picture can be
read back cell by cell.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.files.pictures import UNKNOWN_COLOUR
from ogm_mcmc.plotting.curves import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ['PROBABILITY', 'Closeup', 'Grid', 'Scale', 'grids_png']

DPI = 100
# Pixels around the cells: axis labels, colour bar, title, a line for the legend.
LEFT, RIGHT, BOTTOM, TOP, LEGEND = 64, 92, 50, 30, 24
BAR_GAP, BAR_WIDTH, CLOSEUP_GAP = 12, 14, 16

# left, right, bottom, top
Extent = tuple[float, float, float, float]


class Scale(NamedTuple):
    """What the colour bar says: `colours`, as matplotlib names them, from `low` to `high`.

    Values beyond an end have its colour, and the bar a tip there.
    """

    label: str
    low: float = 0.0
    high: float = 1.0
    colours: str = 'gray_r'


PROBABILITY = Scale('occupancy probability')


class Closeup(NamedTuple):
    """A circle that is shown enlarged under the grid, in the units of the axes."""

    x: float
    y: float
    radius: float


class Grid(NamedTuple):
    """Values (height, width), bottom row first, nan bluish grey; `marks` are drawn over them."""

    values: AnyArray
    extent: Extent
    scale: Scale = PROBABILITY
    title: str = ''
    marks: Sequence[Series] = ()
    closeups: Sequence[Closeup] = ()


class Layout(NamedTuple):
    """Pixels of the cells of each grid, and of what surrounds them."""

    width: int
    height: int
    top: int
    closeup: int

    @property
    def block(self) -> tuple[int, int]:
        """Width and height of a grid with all that belongs to it."""
        below = BOTTOM + (self.closeup + CLOSEUP_GAP if self.closeup else 0)
        return LEFT + self.width + RIGHT, self.top + self.height + below


def grids_png(
    grids: Sequence[Grid], x_label: str, y_label: str, *, columns: int = 1, side: int = 480
) -> bytes:
    """Draw grids of one shape, row by row.

    side  pixels that the longer side of a grid has at least
    """
    from matplotlib.figure import Figure

    layout = _layout(grids, side)
    across, upwards = layout.block
    size = (columns * across, math.ceil(len(grids) / columns) * upwards)
    figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
    for place, grid in enumerate(grids):
        line, column = divmod(place, columns)
        bottom = size[1] - line * upwards - layout.top - layout.height
        axes = _draw(figure, grid, (LEFT + column * across, bottom), layout)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
    stream = io.BytesIO()
    figure.savefig(stream, format='png')
    return stream.getvalue()


def _layout(grids: Sequence[Grid], side: int) -> Layout:
    height, width = grids[0].values.shape
    pixels = max(1, math.ceil(side / max(height, width)))
    legend = any(mark.label for grid in grids for mark in grid.marks)
    n_closeups = max(len(grid.closeups) for grid in grids)
    closeup = (pixels * width - (n_closeups - 1) * CLOSEUP_GAP) // n_closeups if n_closeups else 0
    return Layout(pixels * width, pixels * height, TOP + (LEGEND if legend else 0), closeup)


def _axes(figure: Figure, left: int, bottom: int, width: int, height: int) -> Axes:
    """Add axes at whole pixels."""
    across, upwards = figure.get_size_inches() * DPI
    return figure.add_axes((left / across, bottom / upwards, width / across, height / upwards))


def _draw(figure: Figure, grid: Grid, corner: tuple[int, int], layout: Layout) -> Axes:
    """Draw a grid with all that belongs to it; `corner` is the lower left one of its cells."""
    left, bottom = corner
    axes = _axes(figure, left, bottom, layout.width, layout.height)
    image = _cells(axes, grid)
    below = bool((grid.values < grid.scale.low).any())
    above = bool((grid.values > grid.scale.high).any())
    tips = {(True, True): 'both', (True, False): 'min', (False, True): 'max'}
    bar = _axes(figure, left + layout.width + BAR_GAP, bottom, BAR_WIDTH, layout.height)
    figure.colorbar(
        image,
        cax=bar,
        label=grid.scale.label,
        extend=tips.get((below, above), 'neither'),
        extendfrac=0.04,
    )
    for mark in grid.marks:
        axes.plot(mark.x, mark.y, mark.style, label=mark.label or None, linewidth=1.0)
    if any(mark.label for mark in grid.marks):
        axes.legend(
            loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False,
            borderaxespad=0.2,
        )  # fmt: skip
    axes.set_title(grid.title, fontsize=11, pad=6 + 0.75 * (layout.top - TOP))
    axes.set_xlim(*grid.extent[:2])
    axes.set_ylim(*grid.extent[2:])
    for number, closeup in enumerate(grid.closeups):
        beside = left + number * (layout.closeup + CLOSEUP_GAP)
        under = bottom - BOTTOM - layout.closeup
        inset = _axes(figure, beside, under, layout.closeup, layout.closeup)
        _enlarge(axes, inset, grid, closeup, str(number + 1))
    return axes


def _cells(axes: Axes, grid: Grid) -> Any:
    """Draw the cells alone."""
    from matplotlib import colormaps

    unknown = '#{:02x}{:02x}{:02x}'.format(*UNKNOWN_COLOUR)
    colours = colormaps[grid.scale.colours].with_extremes(bad=unknown)
    return axes.imshow(
        np.clip(grid.values, grid.scale.low, grid.scale.high),
        origin='lower',
        extent=grid.extent,
        aspect='auto',
        interpolation='nearest',
        cmap=colours,
        vmin=grid.scale.low,
        vmax=grid.scale.high,
    )


def _enlarge(axes: Axes, inset: Axes, grid: Grid, closeup: Closeup, name: str) -> None:
    """Draw a circle around a place, and what is in it into the inset."""
    from matplotlib.patches import Circle

    x, y, radius = closeup
    axes.add_patch(Circle((x, y), radius, fill=False, edgecolor='C0', linewidth=1.2))
    axes.text(x + radius, y + radius, name, color='C0', fontsize=11, fontweight='bold')
    image = _cells(inset, grid)
    inset.set_xlim(x - radius, x + radius)
    inset.set_ylim(y - radius, y + radius)
    inset.set_axis_off()
    ring = Circle(
        (0.5, 0.5), 0.5, transform=inset.transAxes, fill=False, edgecolor='C0', clip_on=False
    )
    inset.add_patch(ring)
    image.set_clip_path(ring)
    inset.text(0.0, 0.9, name, color='C0', fontweight='bold', transform=inset.transAxes)
