"""What is refused is said in one line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from ogm_mcmc.errors import OgmError

__all__ = ['error_line', 'refusal_of']


def refusal_of(
    error: type[OgmError], call: Callable[..., object], *arguments: Any, **options: Any
) -> str:
    """Call what has to refuse its arguments; return what it says."""
    with pytest.raises(error) as caught:
        call(*arguments, **options)
    message = str(caught.value)
    assert '\n' not in message
    return message


def error_line(printed: str) -> str:
    """Return the one line that tells of an error, of all that a command printed."""
    lines = [line for line in printed.splitlines() if 'error' in line]
    assert len(lines) == 1, printed
    assert 'Traceback' not in printed
    return lines[0]
