"""Fixtures that several modules of sampling share."""

import pytest

from ogm_mcmc.engine.prior_files import default_prior_file, load_prior


@pytest.fixture(scope='module')
def buildings():
    return load_prior(default_prior_file(), 0.05).counts
