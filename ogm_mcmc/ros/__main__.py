"""`python3 -m ogm_mcmc.ros NODE [--ros-args ...]`."""

import sys

from ogm_mcmc.ros.entry import NODES, run

if len(sys.argv) < 2 or sys.argv[1] not in NODES:
    from ogm_mcmc.files.saying import say  # 30 ms, in which no signal would be handled

    say(f'error: expected one of {", ".join(NODES)}')
    sys.exit(2)
run(sys.argv.pop(1))
