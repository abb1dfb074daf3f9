"""A life-cycle node that survives impossible transitions and logs errors, unlike rclpy's."""

import sys
import traceback
from collections.abc import Callable

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity

Transition = Callable[..., TransitionCallbackReturn]


class ManagedNode(LifecycleNode):
    """Refuses impossible transitions, and logs the errors of possible ones."""

    def __init__(self, name: str) -> None:
        """Make a node in the state ``unconfigured``."""
        super().__init__(name)
        # In Jazzy a request for a transition that is not possible in the present state raises,
        # which ends the process.
        service = self._service_change_state
        self._change_state = service.callback
        service.callback = self._on_change_state

    @property
    def state_label(self) -> str:
        """The present state, such as ``active``."""
        label: str = self._state_machine.current_state[1]
        return label

    def announce(self, text: str) -> None:
        """Log a line of the start.

        For its first line, rclpy's logger looks for the caller among all loaded modules, which
        takes as long as loading a model. Here the caller is given.
        """
        code, line = sys._getframe(1).f_code, sys._getframe(1).f_lineno
        rclpy_implementation.rclpy_logging_rcutils_log(
            LoggingSeverity.INFO,
            *(self.get_logger().name, text, code.co_name, code.co_filename, line),
        )

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        try:
            response = self._change_state(request, response)
            if self.state_label == "finalized":
                self.get_logger().info("finalized: nothing is served any more")
        except rclpy_implementation.RCLError:
            wanted = request.transition.label or f"transition {request.transition.id}"
            self.get_logger().warning(f"refused: {wanted} is not possible when {self.state_label}")
            response.success = False
        return response


def logged(transition: Transition) -> Transition:
    """A transition callback whose exceptions are logged; rclpy drops them silently."""

    def run(node: ManagedNode, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            return transition(node, state)
        except Exception:
            node.get_logger().error(f"{transition.__name__} failed: {traceback.format_exc()}")
            return TransitionCallbackReturn.ERROR

    return run
