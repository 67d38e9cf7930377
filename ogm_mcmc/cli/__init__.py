"""The command line: `python3 -m ogm_mcmc COMMAND`, installed as `ogm_mcmc`.

One module per command, each with `add_to(subparsers)` and `run(options)`; only this package
prints and decides exit codes (0 well, 1 the work failed, 2 a user's mistake in one line).
"""
