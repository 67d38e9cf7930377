"""How far sampling has come, in words."""

import math

import pytest

from ogm_mcmc.engine.progress import Progress


@pytest.mark.parametrize(('chains', 'said'), [(1, 'one chain'), (2, 'each of 2 chains')])
def test_a_run_that_has_ended_is_told_with_its_chains(chains, said):
    progress = Progress(40, 20, 1.5, 27.0, 0.0, math.inf, 9.0, 0.1, -5.0, chains)
    assert progress.said(6) == f'refined 6 scans in 1.5 s: 40 sweeps of {said}, 20 of them counted'
