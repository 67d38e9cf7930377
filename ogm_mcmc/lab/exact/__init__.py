"""The posterior without sampling, where it can be had: the reference for everything else.

`enumeration` goes through all 2^K maps of a small window ([gibbs] section II, "full Bayesian
solution"); `line` is the closed form for cells in one line seen from one end, for any K.
"""

from ogm_mcmc.lab.exact.enumeration import Enumeration, enumerate_maps
from ogm_mcmc.lab.exact.line import line_posterior

__all__ = ['Enumeration', 'enumerate_maps', 'line_posterior']
