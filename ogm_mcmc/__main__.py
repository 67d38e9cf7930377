"""`python3 -m ogm_mcmc`."""

from ogm_mcmc.cli.main import main

main()
