"""Answers to planners: `collision_query` (nav_msgs/Path) in, `collision_risk` out."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

import numpy as np
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import Float32MultiArray, MultiArrayDimension

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.engine.refined_map import RefinedMap
from ogm_mcmc.errors import PoseError
from ogm_mcmc.io import messages
from ogm_mcmc.ros.problems import Problems
from ogm_mcmc.ros.qos import QUESTIONS

__all__ = ['CollisionAnswers']


class CollisionAnswers:
    """One answer to each query, in their order: a probability for each pose, then the way's.

    An answer without numbers says that there is none: the query was of another frame or could
    not be read, or nothing was sampled yet. That is counted and warned about as well.
    """

    def __init__(
        self,
        node: Node,
        problems: Problems,
        frame_id: Callable[[], str],
        newest: Callable[[], RefinedMap | None],
        radius_m: Callable[[], float],
    ) -> None:
        self.problems = problems
        self.frame_id = frame_id
        self.newest = newest
        self.radius_m = radius_m
        self.answered = 0
        self._publisher = node.create_publisher(Float32MultiArray, 'collision_risk', QUESTIONS)
        node.create_subscription(Path, 'collision_query', self.on_query, QUESTIONS)

    def on_query(self, msg: Any) -> None:
        """Answer a query."""
        risk = self._risk(msg)
        answer = Float32MultiArray()
        answer.layout.dim = [
            MultiArrayDimension(label='poses, way', size=risk.size, stride=risk.size)
        ]
        answer.data = array('f', risk.astype(np.float32).tobytes())
        self._publisher.publish(answer)
        self.answered += risk.size > 0

    def _risk(self, msg: Any) -> Float64Array:
        frame, result = messages.frame_of(msg), self.newest()
        none: Float64Array = np.empty(0)
        wanted = self.frame_id()
        if frame != wanted:
            self.problems.warn(
                'collision_query_wrong_frame',
                f'collision_query in frame {frame!r}: expected {wanted!r}',
            )
            return none
        if result is None or result.samples is None:
            self.problems.warn(
                'collision_query_too_early',
                'collision_query: no sweep of a refined map counts yet (~/refine, with '
                'collision_samples above 0)',
            )
            return none
        try:
            return result.collision_risk(messages.read_places(msg), self.radius_m())
        except PoseError as error:
            self.problems.warn('collision_query_invalid', f'collision_query: {error}')
            return none
