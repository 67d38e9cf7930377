"""The leaderboard as a page of Markdown, made from the result of the experiment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.config.sampling import CHAINS_SAID
from ogm_mcmc.lab.experiments.leaderboard_gains import gains
from ogm_mcmc.lab.experiments.mappers import WITH_JOINT_POSES
from ogm_mcmc.lab.experiments.results import markdown_table

__all__ = ['leaderboard_page']

INTRODUCTION = """\
# Leaderboard

Made by `ogm_mcmc experiment leaderboard` (version {version}, seed {seed}): it writes this page as
`leaderboard.md` beside its `result.json`, which has every figure with its standard error.

Maps are made of the even beams of each scan: all of them (100 %), every fourth (25 %), every
twentieth (5 %). All odd beams judge by the log-likelihood of their ranges, nats a beam, higher is
better; only differences in one column mean something. The judge is the beam model with its
defaults and a sigma of 0.05 m; a cell that a map does not know is occupied with probability 0.15,
whoever made the map. Cells are 5 cm in logs and 10 cm in buildings. Sampled maps are the mean of
chains of 60 sweeps, of which up to 20 are burn-in; how many chains follows from the rays:
{chains} (2 of single cells). Rows marked `2 chains` are of two in all of their columns.

With joint poses the same even beams also moved the poses; odd beams of a log then judge the map at
these poses. **In CSAIL, Belgioioso and Freiburg odd beams are no fair judge of joint poses**:
these lidars read them in another turn of the mirror than even ones, while the robot turned on (on
CSAIL by 0.55 degrees, standard deviation). Where pairs of beams judge, one of each turn, joint
poses are first there: [Belgioioso and Freiburg](poses.md#when-beams-were-taken),
[CSAIL](poses.md#particles-mit-csail).

`points` is the area under the ROC curve of points along the odd beams (free every 0.5 m, occupied
at the end). Time is of processors, without compiling and without estimating poses; memory is the
rise of the resident set while the map is made, so memory that was free before does not show. Both
are of 100 %. What the tables say: [results](results.md#leaderboard).
"""

BUILDINGS_TEXT = """\
Means of {count}. Poses are the means of what a particle filter believed. The true map judges, on
the cells that any beam measured; so do odd beams (nats), at the true poses.
"""

CLOSING = """\
## Adding a mapper

A mapper in Python joins the table: add a function to `MAPPERS` in
`ogm_mcmc/lab/experiments/mappers.py`. It gets scans with the belief about their poses, the side of
a cell and what beams without a return mean, and returns a `GridMap`.

A map that another program made is judged from its file. This writes what a mapper may see and
what judges it as two bags:

```python
from pathlib import Path

from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.lab.experiments.contests import log_contest
from ogm_mcmc.lab.experiments.leaderboard import judging_scans, thinned

contest = log_contest('intel')
write_recording(Path('intel_25'), [thinned(one, 4) for one in contest.believed])
write_recording(Path('intel_judge'), judging_scans(contest))
```

```
ogm_mcmc evaluate theirs=map.yaml --beams intel_judge --sigma 0.05 \\
    --no-return ignore --unknown 0.15
```

A map in another frame than these poses is found by `--align`, of every second scan; the others
judge it. Maps that only say free, unknown and occupied are judged as they are. A
beam that contradicts a certain cell costs much, so it is for the mapper to say how sure it is.

## What was not run

- Mappers of others: none mapped the even beams alone. Two maps of another program, made of all
  beams, are [judged by the same odd beams](results.md#maps-of-another-program).
- With joint poses only {joint} are run.
- Methods and priors have their defaults: no `fusion: per_beam`, no other sizes of patches, no
  priors learned from maps of one's own, no `pose_uncertain.map_beams`.
- `sonar` needs ranges of sonars; `pose_uncertain` needs poses with doubt, which are mapped in
  buildings only (the particles of CSAIL: `experiment joint-csail`).
- Logs: their poses are those of the SLAM system that corrected them; of CSAIL, the trajectory of
  GMapping's best particle at the end. Nobody has their truth.
"""


class _Column(NamedTuple):
    """A column: its title, the key of its figure, how it is printed; the best is in bold."""

    title: str
    key: str
    text: str
    highest: bool | None = None


def leaderboard_page(result: Mapping[str, Any]) -> str:
    """Return the page of a result of `experiment leaderboard`, with its version and seed.

    `every` names the data sets and densities of a whole run, so that what is missing is told.
    """
    entries: list[Mapping[str, Any]] = result['entries']
    version, seed = result['version'], result['seed']
    parts = [INTRODUCTION.format(version=version, seed=seed, chains=CHAINS_SAID)]
    names = list(dict.fromkeys(entry['data'] for entry in entries))
    logs = [name for name in names if not name.startswith('building-')]
    for name in logs:
        parts.append(f'## {name}\n\n{_log_table([e for e in entries if e["data"] == name])}')
    buildings = [entry for entry in entries if entry['data'].startswith('building-')]
    if buildings:
        count = len(names) - len(logs)
        said = 'one generated building' if count == 1 else f'{count} generated buildings'
        parts.append(f'## Generated buildings\n\n{BUILDINGS_TEXT.format(count=said)}')
        for percent in _percents(buildings):
            some = [entry for entry in buildings if entry['percent'] == percent]
            parts.append(f'### {percent} % of the beams\n\n{_building_table(some)}')
    parts += gains(entries)
    joint = ' and '.join(f'`{name}`' for name in WITH_JOINT_POSES)
    return '\n'.join([*parts, CLOSING.format(joint=joint) + _left_out(result, names)])


def _left_out(result: Mapping[str, Any], names: Sequence[str]) -> str:
    """Return a line for data sets, densities and scans that this result lacks."""
    every = result['every']
    there = {(entry['data'], entry['percent']) for entry in result['entries']}
    asked = [each for each in every['percents'] if each in {percent for _, percent in there}]
    missing = [name for name in every['names'] if name not in names]
    missing += [f'{each} % of the beams' for each in every['percents'] if each not in asked]
    missing += [
        f'{name} with {each} %' for name in names for each in asked if (name, each) not in there
    ]
    if every.get('scans'):
        missing.append(f'scans but the first {every["scans"]}')
    return f'- In this result: no {", no ".join(missing)}.\n' if missing else ''


def _percents(entries: Iterable[Mapping[str, Any]]) -> list[int]:
    return sorted({entry['percent'] for entry in entries}, reverse=True)


def _log_table(entries: Sequence[Mapping[str, Any]]) -> str:
    percents = _percents(entries)
    lines: dict[str, dict[str, float | None]] = {}
    names = _line_names(entries)
    for entry in entries:
        for mapper, found in entry['mappers'].items():
            line = lines.setdefault(names[mapper, entry['poses']], {})
            line[f'nats {entry["percent"]}'] = found['nats']
            if entry['percent'] == percents[0]:
                line.update({key: found[key] for key in ('points_roc_area', *COSTS)})
    columns = [
        *(_Column(f'{p} %', f'nats {p}', '{:.3f}', highest=True) for p in percents),
        _Column('points', 'points_roc_area', '{:.3f}', highest=True),
        *COST_COLUMNS,
    ]
    return _table(lines, columns)


def _building_table(entries: Sequence[Mapping[str, Any]]) -> str:
    gathered: dict[str, dict[str, list[float]]] = {}
    names = _line_names(entries)
    for entry in entries:
        for mapper, found in entry['mappers'].items():
            line = gathered.setdefault(names[mapper, entry['poses']], {})
            for key, value in found.items():
                if value is not None:
                    line.setdefault(key, []).append(value)
    lines: dict[str, dict[str, float | None]] = {
        name: {key: float(np.mean(values)) for key, values in line.items()}
        for name, line in gathered.items()
    }
    return _table(lines, BUILDING_COLUMNS)


COSTS = ('seconds', 'megabytes')
COST_COLUMNS = (_Column('s', 'seconds', '{:.1f}'), _Column('MB', 'megabytes', '{:.0f}'))
BUILDING_COLUMNS = (
    _Column('nats', 'nats', '{:.3f}', highest=True),
    _Column('best F1', 'best_f1', '{:.3f}', highest=True),
    _Column('F1 at 0.5', 'f1', '{:.3f}', highest=True),
    _Column('ROC area', 'roc_area', '{:.3f}', highest=True),
    _Column('Brier', 'brier', '{:.4f}', highest=False),
    _Column('calibration error', 'calibration_error', '{:.3f}', highest=False),
    *COST_COLUMNS,
)


def _line_names(entries: Iterable[Mapping[str, Any]]) -> dict[tuple[str, str], str]:
    """Return the name of each line, by mapper and poses; it says where all are of 2 chains."""
    chains: dict[tuple[str, str], set[int | None]] = {}
    for entry in entries:
        for mapper, found in entry['mappers'].items():
            chains.setdefault((mapper, entry['poses']), set()).add(found.get('chains'))
    return {
        (mapper, poses): mapper
        + (', joint poses' if poses == 'joint' else '')
        + (', 2 chains' if numbers == {2} else '')
        for (mapper, poses), numbers in chains.items()
    }


def _table(lines: Mapping[str, Mapping[str, float | None]], columns: Sequence[_Column]) -> str:
    best = {}
    for column in columns:
        shown = [
            _shown(line, column) for line in lines.values() if line.get(column.key) is not None
        ]
        if shown and column.highest is not None:
            best[column.key] = (max if column.highest else min)(shown, key=float)
    rows = [('mapper', *(column.title for column in columns))]
    for name, line in lines.items():
        cells = [_shown(line, column) for column in columns]
        rows.append(
            (
                name,
                *(
                    f'**{cell}**' if cell == best.get(column.key) else cell
                    for cell, column in zip(cells, columns, strict=True)
                ),
            )
        )
    return markdown_table(rows)


def _shown(line: Mapping[str, float | None], column: _Column) -> str:
    value = line.get(column.key)
    return '-' if value is None else column.text.format(value)
