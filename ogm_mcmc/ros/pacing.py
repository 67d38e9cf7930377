"""Back-pressure for `replay --rate 0`: go on when the subscribers have taken what was sent.

DDS tells a sender when a message has arrived, not when it was looked at, and a best-effort
reader tells nothing at all. But every node answers its parameter services from the executor
that runs its subscriptions, and an executor takes at most one message per subscription and turn.
So n answered requests mean at least n turns: n messages per topic were taken, if they were there.
"""

from __future__ import annotations

import threading
import time
from collections import Counter

from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.publisher import Publisher

__all__ = ['Pacer']

LOOK_EVERY_S = 1.0
GIVE_UP_S = 5.0
RETRY_S = 2.0
SERVICE_S = 2.0  # a node's services may be discovered after its subscriptions

# A subscription is discovered before the name of the node it belongs to.
UNKNOWN = '_NODE_NAME_UNKNOWN_'
NAMES_KNOWN_AFTER_S = 3.0


class Pacer:
    """Keeps at most `window` messages per topic on the way to the nodes that subscribe.

    To be used from another thread than the one that spins the node. Nodes without parameter
    services (tools of the command line, say) cannot be waited for.
    """

    def __init__(self, node: Node, publishers: dict[str, Publisher], window: int = 4) -> None:
        self.node = node
        self.publishers = publishers
        self.window = window
        self._clients: dict[str, Client] = {}
        self._given_up: dict[str, float] = {}  # by name: until when
        self._since: Counter[str] = Counter()
        self._looked_at = -LOOK_EVERY_S
        self._subscriptions = 0

    def sent(self, publisher: Publisher, stopped: threading.Event) -> None:
        """Count a message; wait when its topic has used up the window."""
        if publisher.get_subscription_count() > 0:
            # What nobody takes need not be waited for.
            self._since[publisher.topic_name] += 1
        subscriptions = sum(p.get_subscription_count() for p in self.publishers.values())
        if subscriptions != self._subscriptions:
            # Somebody came or went: whoever came must not be flooded until the next look.
            self._subscriptions = subscriptions
            self._looked_at = -LOOK_EVERY_S
            self.wait(stopped)
        elif self._since[publisher.topic_name] >= self.window:
            self.wait(stopped)

    def wait(self, stopped: threading.Event) -> None:
        """Wait until the subscribers had as many turns as any topic has messages on the way."""
        self._wait(max(self._since.values(), default=0), stopped)

    def meet(self, stopped: threading.Event) -> None:
        """Wait until each node that subscribes has answered once, before anything is sent.

        We may know of a best-effort subscription a tenth of a second before its node knows of us:
        what is sent meanwhile is lost. Who answers has found the publishers, too: they were there
        before the client, and DDS tells what there is in order.
        """
        self._wait(1, stopped)

    def _wait(self, turns: int, stopped: threading.Event) -> None:
        self._look()
        for _ in range(turns):
            for name, client in list(self._clients.items()):
                if stopped.is_set():
                    break
                if not self._answered(name, client, stopped):
                    self.node.destroy_client(self._clients.pop(name))
        self._since.clear()

    def _look(self) -> None:
        """Find the nodes that subscribe to what was sent."""
        now = time.monotonic()
        if now - self._looked_at < LOOK_EVERY_S:
            return
        self._looked_at = now
        names = self._subscribers()
        deadline = now + NAMES_KNOWN_AFTER_S
        while any(UNKNOWN in name for name in names) and time.monotonic() < deadline:
            time.sleep(0.02)
            names = self._subscribers()
        for name in names - self._clients.keys():
            if time.monotonic() < self._given_up.get(name, 0.0):
                continue
            client = self.node.create_client(GetParameters, f'{name}/get_parameters')
            if client.wait_for_service(timeout_sec=SERVICE_S):
                self._clients[name] = client
            else:
                self._given_up[name] = time.monotonic() + RETRY_S
                self.node.destroy_client(client)
        for name in self._clients.keys() - names:
            self.node.destroy_client(self._clients.pop(name))

    def _subscribers(self) -> set[str]:
        names = set()
        for publisher in self.publishers.values():
            for info in self.node.get_subscriptions_info_by_topic(publisher.topic_name):
                names.add(f'{info.node_namespace.rstrip("/")}/{info.node_name}')
        return names

    def _answered(self, name: str, client: Client, stopped: threading.Event) -> bool:
        """Ask and wait; False when the node has gone or does not answer in time."""
        done = threading.Event()
        future = client.call_async(GetParameters.Request())
        future.add_done_callback(lambda _: done.set())
        deadline = time.monotonic() + GIVE_UP_S
        while not done.wait(0.02):
            if stopped.is_set() or not client.service_is_ready():
                client.remove_pending_request(future)
                return False
            if time.monotonic() > deadline:
                client.remove_pending_request(future)
                self._given_up[name] = time.monotonic() + RETRY_S
                self.node.get_logger().warning(
                    f'{name} does not answer: not waiting for it for {RETRY_S:g} s'
                )
                return False
        return True
