"""How long tests with inputs changed at random go on: a few hundred rounds, or `make fuzz`."""

import os

# Inputs in all; every test does its share of them.
COUNT = int(os.environ.get('OGM_MCMC_FUZZ_COUNT', '6400'))
SHARES = 32

ROUNDS = max(COUNT // SHARES, 1)
SEED = int(os.environ.get('OGM_MCMC_FUZZ_SEED', '20240229'))
