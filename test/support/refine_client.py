"""A refine server and what a user of it sees."""

import signal

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from std_srvs.srv import Trigger

from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.ros.refine_server import RefineServer
from support.local_ros import replayed, spun_node
from support.ros import NodeProcess, takes_scans

__all__ = ['Client', 'ENDLESS', 'QUICK', 'SCANS', 'as_array', 'server', 'server_here', 'stop']

QUICK = {
    'window.resolution': 0.1,
    'model.sigma': 0.03,
    'map_update_interval': 0.2,
    'niceness': 0,
    # Of independent cells: they mix in a few sweeps.
    'patch.prior': 'uniform',
    'patch.size': 1,
}
ENDLESS = {'max_time': 1000.0, 'max_sweeps': 10**8, 'r_hat': 0.0}
SCANS = 193


def server(**parameters):
    dotted = {name.replace('__', '.'): value for name, value in parameters.items()}
    return NodeProcess('refine_server', parameters={**QUICK, **dotted})


def server_here(**parameters):
    """The server in this process: it starts in a fraction of the time."""
    dotted = {name.replace('__', '.'): value for name, value in parameters.items()}
    return spun_node(RefineServer, **{**QUICK, **dotted})


class Client:
    """What a user of the server sees: its maps and diagnostics, and its services."""

    def __init__(self, observer):
        self.observer = observer
        self.maps = observer.collect(OccupancyGrid, 'map_refined', LATCHED)
        self.reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
        observer.until(lambda: takes_scans(self.reports), 200.0)

    def values(self):
        return {item.key: item.value for item in self.reports[-1].status[0].values}

    def wait_for(self, timeout_s=30.0, **expected):
        """Wait for diagnostics; `scans_recorded` stands for 'scans recorded'."""
        wanted = {key.replace('_', ' '): str(value) for key, value in expected.items()}

        def seen():
            values = self.values()
            return all(values.get(key) == value for key, value in wanted.items())

        try:
            self.observer.until(seen, timeout_s)
        except TimeoutError:
            values = self.values()
            assert {key: values.get(key) for key in wanted} == wanted

    def call(self, name):
        return self.observer.call(Trigger, f'refine_server/{name}', Trigger.Request())

    def replay(self, bag):
        replayed(bag, self.observer)

    def record(self, bag, count=SCANS):
        self.replay(bag)
        self.wait_for(scans_recorded=count)

    def refine(self):
        answer = self.call('refine')
        assert answer.success, answer.message
        return answer

    def sweeps(self):
        return int(self.values()['sweeps'])

    def wait_for_map(self, timeout_s=30.0):
        seen = len(self.maps)
        self.observer.until(lambda: len(self.maps) > seen, timeout_s)
        return self.maps[-1]

    def set(self, name, kind, field, value):
        new = ParameterValue(type=kind, **{field: value})
        request = SetParameters.Request(parameters=[Parameter(name=name, value=new)])
        return self.observer.call(SetParameters, 'refine_server/set_parameters', request).results[
            0
        ]


def as_array(msg):
    return np.frombuffer(msg.data, np.int8).reshape(msg.info.height, msg.info.width)


def stop(node, how=signal.SIGINT):
    assert node.stop(how) == 0, node.output
    assert 'Traceback' not in node.output, node.output
