"""Pictures of maps, curves, and pages that hold them.

A page is one file that opens anywhere and needs no network: pictures are embedded as data URIs,
nothing is scripted. Pictures of grids have a pixel per cell and are enlarged by the browser
without smoothing. Curves are drawn by matplotlib (extra `plots`), which is imported where it is
used, so that everything else works without.
"""

from ogm_mcmc.plotting.curves import Series, curves_png, require_matplotlib
from ogm_mcmc.plotting.images import agreement_png, heat_png, kinds_png, probability_png
from ogm_mcmc.plotting.page import Page, Picture

__all__ = [
    'Page',
    'Picture',
    'Series',
    'agreement_png',
    'curves_png',
    'heat_png',
    'kinds_png',
    'probability_png',
    'require_matplotlib',
]
