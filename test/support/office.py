"""How much of the simulated walk through the office the shared bag holds."""

__all__ = ['EVERY', 'OFFICE_SCANS']

OFFICE_SCANS = 290
EVERY = 4
"""Every so many-th of 1158 scans is taken: all of the office is seen, and replays take less."""
