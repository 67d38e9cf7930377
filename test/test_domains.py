"""ROS domains of test workers."""

from support.domains import domain_of


def test_each_worker_has_a_domain_of_its_own_and_none_that_people_use():
    for first in (20, 57, 98, 99):
        domains = [domain_of(first, worker) for worker in range(8)]
        assert domains[0] == first
        assert len(set(domains)) == 8
        assert min(domains) >= 20
        assert max(domains) < 100
