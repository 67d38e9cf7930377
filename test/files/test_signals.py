"""Signals that come at the worst moments: in `ctypes.cast`, where Numba cannot bear one."""

import os
import signal
import subprocess
import sys

import pytest

from ogm_mcmc.files.signals import signals_later

# Takes a Generator apart without end, and is stopped from inside of `ctypes.cast` (by a trace
# function, called at its first line as a signal handler would be).
SWEEPING = """
import ctypes, os, signal, sys, time
import numpy as np
from numba import njit
from ogm_mcmc.cli import entry, main

@njit
def draw(rng):
    return rng.random()

def stop_in_cast(frame, event, argument):
    if frame.f_code is ctypes.cast.__code__:
        sys.settrace(None)
        os.kill(os.getpid(), signal.{signal})
        time.sleep(0.0)
        return None

def run(argv=None):
    main.leave_on_signals()
    rng = np.random.default_rng(1)
    draw(rng)
    print('begun', flush=True)
    sys.settrace(stop_in_cast)
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        draw(rng)
    return 0

main.run = run
entry.main()
"""


@pytest.mark.parametrize(('name', 'code'), [('SIGINT', 130), ('SIGTERM', 143)])
def test_a_stop_while_a_generator_is_taken_apart_is_no_crash(name, code):
    done = subprocess.run(
        [sys.executable, '-c', SWEEPING.format(signal=name)],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, 'begun\n', '')


# Stopped while an object is made: what takes it down later fails, and can only print that.
HALF_MADE = """
import os, signal, time
from ogm_mcmc.cli import entry, main

class Half:
    def __init__(self):
        os.kill(os.getpid(), signal.{signal})
        time.sleep(60.0)
        self.whole = True

    def __del__(self):
        self.whole

main.run = lambda: Half()
entry.main()
"""


@pytest.mark.parametrize(('name', 'code'), [('SIGINT', 130), ('SIGTERM', 143)])
def test_what_was_half_made_when_a_stop_came_is_taken_down_quietly(name, code):
    done = subprocess.run(
        [sys.executable, '-c', HALF_MADE.format(signal=name)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (code, '')


def test_an_ignored_interrupt_stays_ignored():
    """As under nohup in a script: Ctrl-C is not for a program in the background."""
    code = (
        'import os, signal\n'
        'signal.signal(signal.SIGINT, signal.SIG_IGN)\n'
        'from ogm_mcmc.files.signals import leave_on_signals\n'
        'leave_on_signals()\n'
        'os.kill(os.getpid(), signal.SIGINT)\n'
        "print('still here')\n"
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert done.stdout == 'still here\n'


class Stopped(BaseException):
    """What a handler raises."""


@pytest.mark.parametrize('when', [1, 2, 3, 4])
def test_a_stop_beside_handlers_that_change_leaves_them_all_at_work(when, monkeypatch):
    """They are four changes, two before and two after what signals wait for."""

    def stop(number, frame):
        raise Stopped

    install, done = signal.signal, []

    def change(number, handler):
        install(number, handler)
        done.append(number)
        if len(done) == when:
            signal.raise_signal(signal.SIGTERM if when == 1 else signal.SIGINT)

    stops = (signal.SIGINT, signal.SIGTERM)
    before = [install(number, stop) for number in stops]
    try:
        with monkeypatch.context() as patch, pytest.raises(Stopped):  # noqa: PT012
            patch.setattr(signal, 'signal', change)
            with signals_later():
                pass
        for number in stops:
            with pytest.raises(Stopped):
                signal.raise_signal(number)
    finally:
        for number, handler in zip(stops, before, strict=True):
            install(number, handler)
