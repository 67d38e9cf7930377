"""ROS domains of tests that run side by side."""

LOWEST, COUNT = 20, 80


def domain_of(first: int, worker: int) -> int:
    """Return the domain of a worker, 20 to 99: people and robots use those below."""
    return LOWEST + (first - LOWEST + worker) % COUNT
