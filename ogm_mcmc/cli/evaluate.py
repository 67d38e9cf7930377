"""`evaluate MAP`: a map before its judges, as a table, JSON and a page of pictures.

`--truth MAP` is the true map; `--beams BAG` are scans the map has not seen; `--pose X,Y,YAW` asks
what a scan from there would tell; `--path FILE` how likely a way is blocked; `--true-trajectory`
and `--relations` judge poses. MAP is a map YAML or, better, the NPZ that `map` or `sample`
writes: the image of a YAML knows no probabilities between 0 and 1. Several maps,
`NAME=MAP NAME=MAP`, are compared side by side.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from ogm_mcmc.cli.evaluate_answer import (
    Answer,
    make_page,
    output_paths,
    write_answer,
)
from ogm_mcmc.cli.evaluate_beams import by_beams
from ogm_mcmc.cli.evaluate_frames import alignment_of
from ogm_mcmc.cli.evaluate_path import along_path
from ogm_mcmc.cli.evaluate_points import by_points
from ogm_mcmc.cli.evaluate_pose import from_pose, pose_inside, read_pose
from ogm_mcmc.cli.evaluate_several import named_maps
from ogm_mcmc.cli.evaluate_side_by_side import run_several
from ogm_mcmc.cli.evaluate_trajectory import (
    add_trajectory_judges,
    asks_for_poses,
    by_trajectory,
    check_trajectory_options,
)
from ogm_mcmc.cli.evaluate_truth import against_truth
from ogm_mcmc.cli.options import (
    Subparsers,
    add_config_options,
    add_json,
    add_max_cells,
    add_stream_options,
    config_from,
    print_result,
    require_matplotlib,
)
from ogm_mcmc.cli.sample import SHORT
from ogm_mcmc.config import (
    AlignmentConfig,
    CollisionConfig,
    EvaluationConfig,
    ExpectedScanConfig,
    HeldOutConfig,
    HeldOutPointsConfig,
    PlacingConfig,
    add_arguments,
    build,
    flatten,
    given,
    settings_of,
)
from ogm_mcmc.config.nodes import REFINE_CONFIGS, RefineSamplerConfig, judging
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.output_files import checked_name
from ogm_mcmc.io.map_files import JudgedMap, load_judged

__all__ = ['add_to']

# Of the sampler's settings, those that say how a beam is understood.
OF_BEAMS = ('window.max_range', 'window.no_return')
NOT_OF_BEAMS = tuple(
    leaf.name
    for leaf in settings_of(RefineSamplerConfig)
    if not leaf.name.startswith('model.') and leaf.name not in OF_BEAMS
)


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        'evaluate', help='judge a map by the true one, by beams it has not seen, or by itself'
    )
    parser.add_argument(
        'maps', nargs='*', metavar='[NAME=]MAP',
        help='NPZ with probabilities, map YAML, or NPY or MAT with a YAML beside it; several are '
        'compared; none for --estimate',
    )  # fmt: skip
    asked = parser.add_argument_group('judges, at least one')
    asked.add_argument('--truth', type=Path, metavar='MAP', help='the true map, a file likewise')
    asked.add_argument(
        '--beams', dest='bag', type=Path, metavar='BAG',
        help='log-likelihood of the beams of a bag that was not mapped',
    )  # fmt: skip
    asked.add_argument(
        '--pose', metavar='X,Y,YAW',
        help='entropy, and what a scan from there is expected to tell (m, m, rad; --pose=-1,2,0 '
        'where X is negative)',
    )  # fmt: skip
    asked.add_argument(
        '--path', type=Path, metavar='FILE',
        help='how likely a way is blocked, by the maps of --samples: lines x,y or poses as TUM or '
        'EuRoC; cells that data did not move count together, with a chance that the prior of the '
        'samples and what is known tell, or --unknown',
    )  # fmt: skip
    add_trajectory_judges(parser)
    parser.add_argument(
        '-o', dest='folder', type=Path, default=Path('out/evaluate'), metavar='DIR'
    )
    parser.add_argument('--name', default='evaluation', help='name of the JSON and HTML file')
    add_arguments(parser.add_argument_group('what counts'), EvaluationConfig)
    beams = parser.add_argument_group('held-out beams (--beams)')
    add_arguments(beams, HeldOutConfig)
    parser.add_argument(
        '--samples', type=Path, metavar='FILE',
        help='maps that `sample --samples` wrote: --beams judges their mixture, too, and --path '
        'is asked of them',
    )  # fmt: skip
    add_arguments(parser.add_argument_group('who goes the way (--path)'), CollisionConfig)
    beams.add_argument(
        '--points', action='store_true',
        help='judge by points of the beams, too: free along them, occupied where they returned',
    )  # fmt: skip
    add_arguments(beams, HeldOutPointsConfig)
    add_arguments(beams, AlignmentConfig)
    add_stream_options(parser)
    add_arguments(parser.add_argument_group('lidar (--pose)'), ExpectedScanConfig)
    configs = (RefineSamplerConfig, PlacingConfig)
    title = 'how beams are understood (--beams, --pose)'
    add_config_options(parser, title, *configs, without=NOT_OF_BEAMS, short=SHORT)
    add_max_cells(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    files = named_maps(options.maps)
    options.map = next(iter(files.values()), None)
    of_map = any(judge is not None for judge in (options.truth, options.bag, options.pose))
    others = (options.estimate, options.path)
    if not of_map and not asks_for_poses(options) and others == (None, None):
        raise ConfigError(
            f'{options.map or "no map"}: expected at least one of --truth MAP, --beams BAG, '
            '--pose X,Y,YAW, --path FILE, --true-trajectory FILE, --relations FILE'
        )
    if of_map and options.map is None:
        raise ConfigError('no map: expected MAP, which --truth, --beams and --pose judge')
    if options.map is not None and not of_map and not asks_for_poses(options):
        raise ConfigError(f'{options.map}: --path asks the maps of --samples: expected no MAP')
    check_trajectory_options(options)
    _check_samples(options)
    alignment_of(options)
    if options.points and options.bag is None:
        raise ConfigError('--points: expected --beams BAG, whose beams they lie on')
    _refuse_unused(options)
    config = build(EvaluationConfig, given(options, EvaluationConfig))
    checked_name(options.name)
    require_matplotlib()
    if len(files) > 1:
        return run_several(options, files, config)
    answers: dict[str, Answer] = {}
    if asks_for_poses(options):
        answers['poses'] = by_trajectory(options)
    if of_map:
        fills = 'unknown' not in given(options, EvaluationConfig)
        judged = load_judged(options.map, options.max_cells, filled=fills)
        answers.update(_answers(options, judged, config))
    if options.path is not None:
        who = build(CollisionConfig, given(options, CollisionConfig))
        told = 'unknown' in given(options, EvaluationConfig)
        answers['path'] = along_path(options, who, config.unknown, told=told)
    paths = output_paths(options)
    named = {name: answer.figures for name, answer in answers.items() if name != 'truth'}
    against = answers['truth'].figures if 'truth' in answers else {}
    settings: dict[str, Any] = flatten(config)
    for answer in answers.values():
        settings.update(answer.settings)
    result: dict[str, Any] = {
        'map': None if options.map is None else str(options.map),
        **against,
        **named,
        'settings': settings,
        'files': {kind: str(path) for kind, path in paths.items()},
    }
    judged = next(one for one in (options.map, options.estimate, options.path) if one is not None)
    title = judged.name + (f' against {options.truth.name}' if options.truth else '')
    page = make_page(title, list(answers.values()), settings)
    result = write_answer(paths, result, page)
    rows = [row for answer in answers.values() for row in answer.rows]
    lines = [f'{name:<28} {value}' for name, value in rows]
    print_result(options, result, '\n'.join([*lines, str(paths['html'])]))
    return 0


def _refuse_unused(options: argparse.Namespace) -> None:
    """Refuse settings of a judge that is not asked."""
    for config, asked, judge in (
        (HeldOutPointsConfig, options.points or None, '--points'),
        (HeldOutConfig, options.bag, '--beams BAG'),
        (ExpectedScanConfig, options.pose, '--pose X,Y,YAW'),
        (CollisionConfig, options.path, '--path FILE'),
    ):
        for name in given(options, config) if asked is None else ():
            raise ConfigError(f'--{name.replace("_", "-")}: expected {judge} with it')


def _check_samples(options: argparse.Namespace) -> None:
    """Refuse samples without a question, and a question without samples."""
    if options.samples is not None and options.bag is None and options.path is None:
        raise ConfigError(
            f'--samples {options.samples}: expected --beams BAG to judge them by, or --path FILE'
        )
    if options.path is not None and options.samples is None:
        raise ConfigError(f'--path {options.path}: expected --samples FILE, the maps to ask')


def _answers(
    options: argparse.Namespace, judged: JudgedMap, config: EvaluationConfig
) -> dict[str, Answer]:
    """Ask the judges that were named; what is refused is refused before what takes long."""
    read = partial(config_from, options, node='refine_server', node_configs=REFINE_CONFIGS)
    sampler, placing = judging(read(RefineSamplerConfig)), read(PlacingConfig)
    choice = build(HeldOutConfig, given(options, HeldOutConfig))
    points = build(HeldOutPointsConfig, given(options, HeldOutPointsConfig))
    expected = build(ExpectedScanConfig, given(options, ExpectedScanConfig))
    pose = None if options.pose is None else pose_inside(read_pose(options.pose), judged.known)
    answers: dict[str, Answer] = {}
    if options.truth is not None:
        answers['truth'] = against_truth(judged, options.truth, config, options.max_cells)
    output_paths(options)  # what cannot be saved is better said before the work than after it
    if options.bag is not None:
        answers['beams'], beams = by_beams(
            options, judged, config.unknown, choice, placing, sampler
        )
        if options.points:
            answers['points'] = by_points(judged.filled, beams, config, points)
    if pose is not None:
        answers['pose'] = from_pose(judged.known, pose, config.unknown, expected, sampler.model)
    return answers
