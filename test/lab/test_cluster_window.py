"""What a worker builds is the window at home, scans whose rays merge included."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from support.refinements import FIRST, SECOND, maps, settings, taken

from ogm_mcmc.config import StopConfig
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.errors import WindowError
from ogm_mcmc.lab.cluster import distribute

STOP = StopConfig(max_sweeps=40, max_time=1e6, r_hat=0.0)


def sample_elsewhere(refinement, scans):
    with ThreadPoolExecutor(1) as pool:
        distribute(refinement, scans, pool)
        list(refinement.run(STOP))


@pytest.mark.jit
def test_rays_that_merge_are_sampled_elsewhere_as_here():
    """A robot that stands: every beam comes twice, and its rays are held once."""
    scans = [FIRST, SECOND, FIRST._replace(), SECOND._replace()]
    here, there = taken(*scans), taken(*scans)
    assert there.size.n_merged > 0
    list(here.run(STOP))
    sample_elsewhere(there, scans)
    assert maps(here) == maps(there)
    for mine, theirs in zip(here.sampler.counts, there.sampler.counts, strict=True):
        assert np.array_equal(mine.counts, theirs.counts)
    assert here.sampler.log_likelihoods() == there.sampler.log_likelihoods()
    # Each chain is sent once, and comes back as what was added.
    jobs, told, answered = there.sampler.traffic
    counts = sum(counts.counts.nbytes for counts in there.sampler.counts)
    assert jobs > there.sampler.n_chains
    assert 0 < told < counts / 10
    assert 0 < answered < jobs * counts / 10


@pytest.mark.jit
def test_other_scans_than_those_taken_are_noticed():
    for others in ([FIRST], [FIRST, FIRST._replace(), SECOND]):
        refinement = taken(FIRST, SECOND)
        with pytest.raises(WindowError, match='on a worker'):
            sample_elsewhere(refinement, others)
    with pytest.raises(WindowError, match='nothing to sample'):
        sample_elsewhere(Refinement(settings()), [FIRST])
