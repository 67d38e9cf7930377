"""`python3 -m ogm_mcmc`."""

from ogm_mcmc.cli.entry import main

main()
