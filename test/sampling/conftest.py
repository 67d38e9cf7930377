"""Fixtures that several modules of sampling share."""

import pytest
from support.local_tiles import MODEL, WINDOW, room

from ogm_mcmc.engine.prior_files import default_prior_file, load_prior
from ogm_mcmc.sampling import RayWindow


@pytest.fixture(scope='module')
def buildings():
    return load_prior(default_prior_file(), 0.05).counts


@pytest.fixture(scope='module')
def scans():
    """Scans of a small room."""
    return room()


@pytest.fixture(scope='module')
def window(scans):
    """The rays of that room as a whole."""
    window = RayWindow(WINDOW, MODEL, margin=5)
    window.add(scans)
    return window
