"""What memory a process takes: as Linux tells it, or not known."""

from pathlib import Path

import pytest

from ogm_mcmc.lab import memory


def test_figures_are_megabytes_of_a_million_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / 'status').write_text('Name:\tx\nVmHWM:\t  250000 kB\nVmRSS:\t    1000 kB\n')
    monkeypatch.setattr(memory, 'PROC', tmp_path)
    assert memory.memory_mb('VmRSS') == pytest.approx(1.024)
    assert memory.peak_mb() == 256.0


def test_where_the_system_does_not_tell_nothing_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(memory, 'PROC', tmp_path)
    assert memory.peak_mb() is None
    (tmp_path / 'status').write_text('Name:\tx\n')
    assert memory.memory_mb('VmRSS') is None
