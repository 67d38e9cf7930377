"""Pictures of maps, curves, and pages that hold them.

A page is one file that opens anywhere and needs no network: pictures are embedded as data URIs,
nothing is scripted. Pictures of `images` have a pixel per cell and are enlarged by the browser
without smoothing. Curves, and grids with axes and a colour bar, are drawn by matplotlib (extra
`plots`), which is imported where it is used, so that everything else works without. Commands that
draw ask for it before long work.
"""

from ogm_mcmc.plotting.curves import Series, curves_png
from ogm_mcmc.plotting.grids import PROBABILITY, Closeup, Grid, Scale, grids_png
from ogm_mcmc.plotting.images import agreement_png, heat_png, kinds_png, probability_png
from ogm_mcmc.plotting.page import Page, Picture

__all__ = [
    'PROBABILITY',
    'Closeup',
    'Grid',
    'Page',
    'Picture',
    'Scale',
    'Series',
    'agreement_png',
    'curves_png',
    'grids_png',
    'heat_png',
    'kinds_png',
    'probability_png',
]
