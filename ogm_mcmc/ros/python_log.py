"""What the package says by Python's `logging`, said by the log of a node."""

from __future__ import annotations

import logging

from rclpy.node import Node

__all__ = ['PythonLog']

SOURCE = logging.getLogger('ogm_mcmc')


class PythonLog(logging.Handler):
    """Hands lines on to a node, from `begin` to `end`; without it they go to stderr, bare."""

    def __init__(self, node: Node) -> None:
        super().__init__()
        self.node = node

    def begin(self) -> None:
        """Take the lines from now on."""
        SOURCE.addHandler(self)

    def end(self) -> None:
        """Leave them to others."""
        SOURCE.removeHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Say a line at its level."""
        logger = self.node.get_logger()
        if record.levelno >= logging.ERROR:
            logger.error(record.getMessage())
        elif record.levelno >= logging.WARNING:
            logger.warning(record.getMessage())
        else:
            logger.info(record.getMessage())
