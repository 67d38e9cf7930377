"""`call`: services of running nodes, from the command line."""

import json
import threading

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from std_srvs.srv import Empty, SetBool, Trigger
from support.local_ros import local_node, spinning

from ogm_mcmc.cli.main import run

pytestmark = [pytest.mark.ros]


@pytest.fixture(scope='module')
def asked():
    """A node whose services tell what they were asked; the list of what that was."""
    heard = []

    def on_work(_, response):
        heard.append('work')
        response.success, response.message = True, 'at work'
        return response

    def on_slow(_, response):
        heard.append('slow')
        threading.Event().wait(0.3)
        response.success = True
        return response

    def on_refuse(_, response):
        response.message = 'nothing to do'
        return response

    def on_pause(request, response):
        heard.append(request.data)
        response.success, response.message = True, f'paused: {request.data}'
        return response

    with local_node(name='robot') as node:
        node.create_service(Trigger, '~/work', on_work)
        node.create_service(Trigger, '~/slow', on_slow)
        node.create_service(Trigger, '~/refuse', on_refuse)
        node.create_service(SetBool, '~/pause', on_pause)
        node.create_service(Empty, '~/empty', lambda _, response: response)
        with spinning(node):
            yield heard


@pytest.mark.parametrize(
    ('words', 'heard', 'said'),
    [
        (['robot/work'], 'work', 'at work'),
        (['/robot/work'], 'work', 'at work'),
        (['robot/pause', 'true'], True, 'paused: True'),
        (['robot/pause', 'false'], False, 'paused: False'),
    ],
)
def test_a_service_is_called_and_its_answer_printed(words, heard, said, asked, capsys):
    assert run(['call', *words]) == 0
    assert asked[-1] == heard
    assert capsys.readouterr().out == f'{said}\n'


def test_a_service_that_takes_long_is_called_once(asked, monkeypatch, capsys):
    monkeypatch.setattr('ogm_mcmc.ros.asking.AGAIN_S', 0.1)
    assert run(['call', 'robot/slow']) == 0
    assert run(['call', 'robot/work']) == 0  # what came before it is heard by now
    assert asked.count('slow') == 1


def test_without_a_name_what_can_be_called_is_listed(asked, capsys):
    assert run(['call', '--json']) == 0
    services = json.loads(capsys.readouterr().out)['services']
    assert {name: kind for name, kind in services.items() if name.startswith('/robot/')} == {
        '/robot/pause': 'std_srvs/srv/SetBool',
        '/robot/refuse': 'std_srvs/srv/Trigger',
        '/robot/slow': 'std_srvs/srv/Trigger',
        '/robot/work': 'std_srvs/srv/Trigger',
    }


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        (['robot/refuse'], '/robot/refuse: nothing to do'),
        (['robot/work', 'true'], '/robot/work is a std_srvs/srv/Trigger: expected no value'),
        (['robot/pause'], 'is a std_srvs/srv/SetBool: expected a value, true or false'),
        (
            ['robot/empty'],
            '/robot/empty is a std_srvs/srv/Empty: expected std_srvs/srv/Trigger or std_srvs/',
        ),
        (['robot/nap', '--timeout', '.5'], 'no service /robot/nap within 0.5 s; that can be'),
        (['a b'], "'a b' is no name of a service"),
        ([''], "'' is no name of a service"),
        (['robot/work', '--timeout', '0'], '--timeout is 0: expected more than 0 s'),
        (['robot/work', '--timeout', 'nan'], '--timeout is nan: expected more than 0 s'),
    ],
)
def test_what_is_wrong_is_said_in_one_line(words, reason, asked, capsys):
    assert run(['call', *words]) == 2
    said = capsys.readouterr()
    assert said.out == ''
    assert said.err.startswith('ogm_mcmc call: error: ')
    assert reason in said.err
    assert said.err.count('\n') == 1
