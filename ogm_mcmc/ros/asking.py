"""Calling a service so that a lost answer does not hang the caller."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.client import Client

__all__ = ['ask']

SpinWhile = Callable[[Callable[[], bool], float], bool]

# Longer than any service of this package takes to answer.
AGAIN_S = 5.0

# A server may find its caller so much later than that found it, s.
FOUND_S = 0.2


def ask(
    client: Client,
    request: Any,
    spin_while: SpinWhile,
    timeout_s: float,
    *,
    once: bool = False,
) -> Any:
    """Call a service and return its response, None when there was none in time.

    A server that has not yet discovered the caller's reader waits 0.1 s for it and then lets the
    answer go; on a busy machine that happens to callers that have just started. So ask again: only
    for requests that may be carried out twice. Others are asked `once`, a little after the service
    was found. `spin_while(condition, timeout_s)` handles messages while a condition holds and says
    whether it ended before the time did.
    """
    deadline = time.monotonic() + timeout_s
    if not spin_while(lambda: not client.service_is_ready(), timeout_s):
        return None
    if once:
        spin_while(lambda: True, min(FOUND_S, deadline - time.monotonic()))
        return _ask_once(client, request, spin_while, deadline - time.monotonic())
    while (left := deadline - time.monotonic()) > 0.0:
        response = _ask_once(client, request, spin_while, min(AGAIN_S, left))
        if response is not None:
            return response
    return None


def _ask_once(client: Client, request: Any, spin_while: SpinWhile, timeout_s: float) -> Any:
    future = client.call_async(request)
    if spin_while(lambda: not future.done(), timeout_s):
        return future.result()
    client.remove_pending_request(future)
    return None
