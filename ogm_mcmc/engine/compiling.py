"""What makes the compiler quicker."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator

__all__ = ['uncollected']


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Leave Python's garbage alone in the block, as a compiler makes little and holds much.

    All kernels of the sampler, cold: 36 s of CPU and 540 MB at most, 47 s and 350 MB with it.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
