"""Fixtures that several modules of the engine share."""

import pytest
from support.workers import CONFIG

from ogm_mcmc.engine.warm_up import warm_up_poses, warm_up_sampling
from ogm_mcmc.engine.worker import RefineWorker


@pytest.fixture(scope='session')
def compiled():
    """Compile what has a deadline in tests of the worker before the clock runs."""
    warm_up_sampling(CONFIG)
    assert warm_up_poses() > 2


@pytest.fixture
def make():
    """Make workers that are closed whatever happens."""
    made = []

    def one(**options):
        made.append(RefineWorker(options.pop('config', CONFIG), **options))
        return made[-1]

    yield one
    for worker in made:
        worker.close()
        assert not worker.running
        assert worker.failure is None
