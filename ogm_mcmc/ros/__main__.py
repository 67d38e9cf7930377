"""`python3 -m ogm_mcmc.ros NODE [--ros-args ...]`."""

import sys

from ogm_mcmc.ros.entry import NODES, run

if len(sys.argv) < 2 or sys.argv[1] not in NODES:
    print(f'error: expected one of {", ".join(NODES)}', file=sys.stderr)
    sys.exit(2)
run(sys.argv.pop(1))
