"""The oldest scans of a recording go where there are too many; snapshots stay."""

from support.refinements import FIRST, SECOND, S, scan_at

from ogm_mcmc.config import (
    KeepConfig,
    RecordingConfig,
)
from ogm_mcmc.engine.recording import Recording


def stamped(seconds, beams=2):
    return scan_at(0.0, 0.0, *[1.0] * beams, stamp_ns=round(seconds * S))


def recorded(scans, **limits):
    recording = Recording(RecordingConfig(KeepConfig(keep='latest'), **limits))
    for scan in scans:
        recording.add(scan)
    return recording


def test_the_oldest_scans_go_when_there_are_too_many():
    scans = [stamped(i) for i in range(5)]
    recording = recorded(scans, max_scans=3)
    assert recording.snapshot() == scans[2:]
    assert (len(recording), recording.n_rays) == (3, 6)


def test_the_oldest_scans_go_when_they_have_too_many_rays():
    scans = [stamped(i, beams=3) for i in range(5)]
    recording = recorded(scans, max_rays=7)
    assert recording.snapshot() == scans[3:]
    assert recording.n_rays == 6
    # The newest is kept whatever its size.
    large = stamped(9, beams=50)
    recording.add(large)
    assert recording.snapshot() == [large]


def test_scans_that_are_too_old_go():
    scans = [stamped(s) for s in (0.0, 1.0, 5.0, 10.0)]
    assert recorded(scans, max_seconds=5.0).snapshot() == scans[2:]
    assert recorded(scans, max_seconds=0.0).snapshot() == scans


def test_a_snapshot_stays_as_it_is():
    recording = recorded([FIRST])
    snapshot = recording.snapshot()
    recording.add(SECOND)
    assert snapshot == [FIRST]
    recording.clear()
    assert (len(recording), recording.n_rays, recording.snapshot()) == (0, 0, [])
