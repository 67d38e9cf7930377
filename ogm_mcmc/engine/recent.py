"""A dictionary that forgets: what messages name must not fill the memory."""

from __future__ import annotations

from typing import TypeVar

__all__ = ['MAX_FRAMES', 'Recent']

Value = TypeVar('Value')

# No robot has more sensors; a sender that makes up frames does.
MAX_FRAMES = 1000


class Recent(dict[str, Value]):
    """Values by name; of more than `limit` names the one not set for longest goes."""

    def __init__(self, limit: int = MAX_FRAMES) -> None:
        super().__init__()
        self.limit = limit

    def __setitem__(self, name: str, value: Value) -> None:
        """Set a value and let the oldest go where there are too many."""
        self.pop(name, None)
        super().__setitem__(name, value)
        if len(self) > self.limit:
            del self[next(iter(self))]
