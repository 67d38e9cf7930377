"""How the process of a node ends."""

import subprocess
import sys

import pytest

# Whatever hangs on at exit: Numba and DDS take a while on a busy machine.
PROGRAM = """
import atexit, sys, time
from types import ModuleType
from ogm_mcmc.ros import entry
atexit.register(time.sleep, 60.0)
node = ModuleType('ogm_mcmc.ros.online_mapper')
node.main = lambda: (sys.stdout.write('the last word'), sys.exit({code}))
sys.modules[node.__name__] = node
entry.online_mapper()
"""


@pytest.mark.parametrize(('code', 'expected'), [('0', 0), ('2', 2), ('None', 0)])
def test_a_node_that_is_done_ends_at_once_and_its_output_is_whole(code, expected):
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM.format(code=code)],
        stdout=subprocess.PIPE,
        timeout=30,
        text=True,
    )
    assert (done.returncode, done.stdout) == (expected, 'the last word')
