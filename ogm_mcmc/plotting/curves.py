"""Curves, as PNG pictures made by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray

__all__ = ['Series', 'curves_png']


class Series(NamedTuple):
    """One curve: its label, x (N,) and y (N,); `style` as matplotlib has it."""

    label: str
    x: AnyArray
    y: AnyArray
    style: str = '-'


def curves_png(
    series: Sequence[Series],
    x_label: str,
    y_label: str,
    *,
    x_limits: tuple[float, float] | None = None,
    y_limits: tuple[float, float] | None = None,
    log_y: bool = False,
    log_x: bool = False,
) -> bytes:
    """Draw curves into one picture of 640 x 480 pixels; ticks of integers are integers.

    Curves are given whole, a point for every threshold: matplotlib leaves out what lies within a
    ninth of a pixel of the line without it (three million points of a ROC curve: half a second).
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.4, 4.8), dpi=100, layout='tight')
    axes = figure.add_subplot()
    for curve in series:
        axes.plot(curve.x, curve.y, curve.style, label=curve.label, linewidth=1.5)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(visible=True, alpha=0.3)
    if x_limits is not None:
        axes.set_xlim(*x_limits)
    if y_limits is not None:
        axes.set_ylim(*y_limits)
    if log_x:
        axes.set_xscale('log')
    elif all(np.issubdtype(np.asarray(curve.x).dtype, np.integer) for curve in series):
        # Numbers of cells, sweeps or experiments: there is nothing half way between two.
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if log_y:
        axes.set_yscale('log')
    if len(series) > 1:
        axes.legend(fontsize=8)
    stream = io.BytesIO()
    figure.savefig(stream, format='png')
    return stream.getvalue()
