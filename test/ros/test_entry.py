"""How the process of a node ends."""

import signal
import subprocess
import sys
import time

import pytest

from ogm_mcmc.files import processes

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


def test_a_node_runs_where_its_streams_are_closed():
    program = PROGRAM.replace('sys.stdout.write(', 'str(').format(code='3')
    shell = 'exec "$0" -c "$1" 1>&- 2>&-'
    assert subprocess.run(['sh', '-c', shell, sys.executable, program], timeout=30).returncode == 3


# A process that is killed at once, and a node in a process of its own that it has started.
KILLED = """
import os, signal, subprocess, sys
from ogm_mcmc.files.processes import ending_with_this
subprocess.Popen([sys.executable, '-c', {node!r}], env=ending_with_this())
os.kill(os.getpid(), signal.SIGKILL)
"""
ENDLESS = PROGRAM.replace('sys.exit({code})', 'sys.stdout.flush(), time.sleep(60.0)')


def test_a_node_ends_when_the_process_that_runs_it_is_killed():
    done = subprocess.run(
        [sys.executable, '-c', KILLED.format(node=ENDLESS)],
        stdout=subprocess.PIPE,  # which the node has, too: it is read until that ends
        timeout=30,
        text=True,
    )
    assert done.returncode == -signal.SIGKILL


def test_only_a_node_that_is_asked_to_ends_with_its_parent(monkeypatch):
    watched = []
    monkeypatch.setattr(processes, '_end_after', watched.append)
    monkeypatch.delenv(processes.PARENT, raising=False)
    processes.end_with_parent()
    assert watched == []
    monkeypatch.setenv(processes.PARENT, '17')
    for _ in range(2):  # the second stands for a child of its own
        processes.end_with_parent()
    deadline = time.monotonic() + 10.0
    while not watched and time.monotonic() < deadline:
        time.sleep(0.01)
    assert watched == ['17']
