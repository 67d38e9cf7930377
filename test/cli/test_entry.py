"""Ctrl-C where Python cannot raise: inside a callback from C, as when Numba compiles.

And standard streams that are closed.
"""

import os
import signal
import subprocess
import sys

import pytest

from ogm_mcmc.cli import entry, main

CALLBACK = """
import ctypes, os, sys, time
from ogm_mcmc.cli import entry, main

def run(argv=None):
    @ctypes.CFUNCTYPE(None)
    def callback():
        os.kill(os.getpid(), {signal})
        time.sleep(0)
    {install}
    callback()
    time.sleep(5.0)
    return 0

main.run = run
entry.main()
"""


@pytest.mark.parametrize(('how', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stop_inside_a_callback_is_not_lost_and_not_loud(how, code):
    install = 'pass'
    if how == signal.SIGTERM:
        install = 'import signal; signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))'
    done = subprocess.run(
        [sys.executable, '-c', CALLBACK.format(signal=int(how), install=install)],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == code, done.stderr
    assert done.stderr == ''


AT_THE_END = """
import atexit, os, sys, time
from ogm_mcmc.cli import entry, main

def hit():
    os.kill(os.getpid(), {signal})
    time.sleep(60.0)

def run(argv=None):
    atexit.register(hit)
    sys.stdout.write('a result')
    {end}
    return 0

main.run = run
entry.main()
"""


@pytest.mark.parametrize(
    ('end', 'how', 'code'),
    [
        ('pass', signal.SIGINT, 0),
        ('raise KeyboardInterrupt', signal.SIGINT, 130),
        ('sys.exit(143)', signal.SIGTERM, 143),
    ],
)
def test_a_stop_while_python_takes_itself_down_is_quiet(end, how, code):
    """Of a command that is done, or was stopped before; Python 3.12 starts no thread any more."""
    done = subprocess.run(
        [sys.executable, '-c', AT_THE_END.format(signal=int(how), end=end)],
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, 'a result', '')


CLOSED = """
import os, sys
from ogm_mcmc.cli import entry, main

def run(argv=None):
    with open(sys.argv[1], 'wb') as own:
        print('a note', file=sys.stderr)
        print('a result')
        own.write(str(own.fileno()).encode())
    return 0

main.run = run
entry.main()
"""


def test_closed_streams_are_not_taken_by_files(tmp_path):
    """With `2>&-` no map was made, and the first file opened took the place of the stream."""
    shell = f'exec "$0" -c "$1" "{tmp_path}/own" 0<&- 1>&- 2>&-'
    done = subprocess.run(['sh', '-c', shell, sys.executable, CLOSED], timeout=60)
    assert done.returncode == 0
    assert int((tmp_path / 'own').read_text()) > 2


@pytest.mark.parametrize(
    ('stop', 'code'), [(KeyboardInterrupt(), 130), (SystemExit(143), 143), (ValueError(), None)]
)
def test_a_stop_while_a_class_is_made_is_quiet(monkeypatch, stop, code):
    """Python 3.11 tells what `__set_name__` raises as a RuntimeError of that cause."""

    class Field:
        def __set_name__(self, owner, name):
            raise stop

    def run(argv=None):
        type('Settings', (), {'field': Field()})
        return 0

    monkeypatch.setattr(main, 'run', run)
    monkeypatch.setattr(entry, 'leave_on_signals', lambda: None)
    monkeypatch.setattr(entry, 'end_at_once_on_signals', lambda code: None)
    monkeypatch.setattr(sys, 'unraisablehook', sys.unraisablehook)
    if code is None:
        with pytest.raises((RuntimeError, ValueError)):
            entry.main()
    else:
        with pytest.raises(SystemExit) as left:
            entry.main()
        assert left.value.code == code
