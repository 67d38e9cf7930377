"""What Nav2's lifecycle manager does with its nodes, written anew from its published behaviour.

Each node in turn is asked for a transition by `NAME/change_state`; then `NAME/get_state` has to
tell the state that follows from it, else the manager gives up, whatever the answer was. Upwards
it goes in the order of the names, downwards in reverse. No bond (`bond_timeout: 0.0`).
"""

from __future__ import annotations

from collections.abc import Sequence

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from support.ros import Observer

__all__ = ['LifecycleManager']

UP = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
}
DOWN = {
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
    Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: State.PRIMARY_STATE_FINALIZED,
}


class LifecycleManager:
    """Commands of the manager; each returns whether all nodes followed."""

    def __init__(self, observer: Observer, node_names: Sequence[str]) -> None:
        self.observer, self.node_names = observer, node_names

    def startup(self) -> bool:
        """Configure all, then activate all."""
        return self._all(Transition.TRANSITION_CONFIGURE) and self.resume()

    def resume(self) -> bool:
        """Activate all."""
        return self._all(Transition.TRANSITION_ACTIVATE)

    def pause(self) -> bool:
        """Deactivate all."""
        return self._all(Transition.TRANSITION_DEACTIVATE)

    def reset(self) -> bool:
        """Deactivate all, then clean all up."""
        return self.pause() and self._all(Transition.TRANSITION_CLEANUP)

    def shutdown(self) -> bool:
        """Deactivate, clean up and shut down all, each step whatever came of the one before."""
        done = [self._all(transition) for transition in DOWN]
        return all(done)

    def state(self, name: str) -> int:
        """Return the id of the state of a node."""
        answer = self.observer.call(GetState, f'{name}/get_state', GetState.Request())
        return int(answer.current_state.id)

    def _all(self, transition: int) -> bool:
        up = transition in UP
        names = self.node_names if up else tuple(reversed(self.node_names))
        return all(self._change(name, transition) for name in names)

    def _change(self, name: str, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        self.observer.call(ChangeState, f'{name}/change_state', request)
        return self.state(name) == {**UP, **DOWN}[transition]
