"""A clean copy of the tree installs by pip and by colcon, and what is installed runs."""

import os
import shutil
import site
import subprocess
import sys
import venv
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


def environment(**extra):
    # Inherited from a re-executed rclpy interpreter it would keep the child's from setting up.
    kept = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
    kept.pop('PYTHONPATH', None)
    return {**kept, **extra}


def run(*command, cwd, timeout=300, **extra):
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=environment(**extra),
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    assert done.returncode == 0, f'{command}\n{done.stdout}\n{done.stderr}'
    return done.stdout


@pytest.fixture(scope='module')
def clean_copy(repository, tmp_path_factory) -> Path:
    """The tree as git would hand it out: tracked files and new ones that are not ignored."""
    copy = tmp_path_factory.mktemp('clean') / 'ogm_mcmc'
    listed = subprocess.run(
        ['git', 'ls-files', '--cached', '--others', '--exclude-standard', '-z'],
        cwd=repository,
        capture_output=True,
    )
    if listed.returncode != 0:
        pytest.skip('not a git checkout: cannot tell which files belong to the tree')
    for name in filter(None, listed.stdout.decode().split('\0')):
        if (repository / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(repository / name, copy / name)
    return copy


def modules_of(tree: Path) -> set[str]:
    return {
        str(path.relative_to(tree)) for path in (tree / 'ogm_mcmc').rglob('*.py') if path.is_file()
    }


def test_pip_installs_every_module_and_the_scripts(clean_copy, tmp_path, office_bag):
    """The dependencies come from the running environment: this is about our own files."""
    venv.create(tmp_path / 'venv', with_pip=False)
    folder = tmp_path / 'venv' / 'lib' / f'python3.{sys.version_info[1]}' / 'site-packages'
    run(
        *(sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--use-pep517'),
        *('--no-build-isolation', '--prefix', tmp_path / 'venv', '--ignore-installed', '.'),
        cwd=clean_copy,
    )
    assert modules_of(clean_copy) == modules_of(folder)
    assert (folder / 'ogm_mcmc' / 'py.typed').is_file()
    # Our package from there, everything else from here.
    path = os.pathsep.join([str(folder), *site.getsitepackages()])
    where = 'import ogm_mcmc; print(ogm_mcmc.__file__)'
    shown = run(sys.executable, '-S', '-c', where, cwd=tmp_path, PYTHONPATH=path)
    assert Path(shown.strip()).is_relative_to(folder)
    prior = 'from ogm_mcmc.engine.prior_files import *; print(default_prior_file())'
    found = Path(run(sys.executable, '-S', '-c', prior, cwd=tmp_path, PYTHONPATH=path).strip())
    assert found == tmp_path / 'venv' / 'share' / 'ogm_mcmc' / 'priors' / 'buildings.npz'
    scripts = tmp_path / 'venv' / 'bin'
    installed = {item.name for item in scripts.iterdir()}
    assert {'ogm_mcmc', 'online_mapper', 'refine_server'} <= installed
    # So common a name is left to `ogm_mcmc replay` and to `ros2 run ogm_mcmc replay`.
    assert 'replay' not in installed
    command = ('map', office_bag, '-o', tmp_path / 'map')
    run(sys.executable, scripts / 'ogm_mcmc', *command, cwd=tmp_path, PYTHONPATH=path)
    assert (tmp_path / 'map' / 'map.yaml').is_file()


def test_colcon_builds_and_the_executables_run(clean_copy, tmp_path, office_bag):
    colcon = shutil.which('colcon', path=f'{Path(sys.executable).parent}:{os.environ["PATH"]}')
    if colcon is None:
        pytest.skip('colcon is not installed')
    pytest.importorskip('rclpy', reason='rclpy is not installed: nothing to run')
    from rclpy.qos import qos_profile_system_default  # noqa: F401 - rclpy really works
    from support.ros import NodeProcess, Observer

    (tmp_path / 'src').mkdir()
    shutil.copytree(clean_copy, tmp_path / 'src' / 'ogm_mcmc')
    run(colcon, 'build', '--event-handlers', 'console_direct+', cwd=tmp_path)
    install = tmp_path / 'install' / 'ogm_mcmc'
    assert modules_of(clean_copy) == modules_of(next(install.glob('lib/python3*/site-packages')))
    share = install / 'share' / 'ogm_mcmc'
    assert (share / 'package.xml').is_file()
    for node in ('online_mapper', 'refine_server'):
        assert (share / 'config' / f'{node}.yaml').is_file()
        assert (share / 'launch' / f'{node}.launch.py').is_file()
    assert (share / 'priors' / 'buildings.npz').is_file()
    assert {'maps.rviz', 'maps.foxglove.json'} <= {one.name for one in (share / 'view').iterdir()}
    assert (share / 'launch' / 'nav2.launch.py').is_file()
    assert (install / 'share/ament_index/resource_index/packages/ogm_mcmc').is_file()

    from std_srvs.srv import Trigger

    source = 'unset _ROS_WHEELS_BOOTSTRAP_COMPLETE; . install/setup.sh; exec "$0" "$@"'
    shell = ('sh', '-c', f'cd {tmp_path}; {source}')
    # Launch files find what they share in the package that is installed, not in the source tree.
    launched = clean_copy / 'test' / 'support' / 'launch_files.py'
    files = sorted((share / 'launch').iterdir())
    said = run(*shell, sys.executable, launched, *files, cwd=tmp_path).splitlines()
    assert len(said) == len(files) == 4
    assert all(str(install) in line for line in said)
    yaml = share / 'config' / 'online_mapper.yaml'
    mapper = NodeProcess(
        '',
        ['--ros-args', '--params-file', str(yaml), '-p', f'save_directory:={tmp_path}/map'],
        command=(*shell, str(install / 'lib/ogm_mcmc/online_mapper')),
    )
    player = NodeProcess(
        '',
        [str(office_bag), '--rate', '0', '--wait', '200', '--wait-topics', '2'],
        command=(*shell, str(install / 'lib/ogm_mcmc/replay')),
    )
    with Observer() as observer, mapper:
        with player:
            observer.until(lambda: not player.running() or not mapper.running(), 120.0)
            assert player.wait() == 0, player.output + mapper.output
        saved = observer.call(Trigger, 'online_mapper/save_map', Trigger.Request())
        assert saved.success, saved.message
        assert mapper.stop() == 0, mapper.output
    assert (tmp_path / 'map' / 'map.pgm').is_file()


@pytest.mark.full
def test_make_demo_from_nothing(clean_copy, tmp_path):
    """README's first command on a fresh machine: a new environment with all dependencies."""
    shutil.copytree(clean_copy, tmp_path / 'fresh')
    run('make', 'demo', cwd=tmp_path / 'fresh', timeout=900)
    assert (tmp_path / 'fresh' / 'out' / 'demo' / 'map.png').stat().st_size > 1000
    run('.venv/bin/python', '-m', 'ogm_mcmc', '--version', cwd=tmp_path / 'fresh')
