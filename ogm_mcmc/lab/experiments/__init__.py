"""The published tables and figures, one command each: `ogm_mcmc experiment NAME`.

How to add one: write a module with a function

    def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]

and name it in `EXPERIMENTS`. It may write PNG pictures into `folder`, which exists, with
`results.save_picture`, and returns what came out, ready for JSON. These keys are shown on the
page and on the terminal if present:

``rows``      a list made by `row`: what was measured, our value beside the published one
``pictures``  captions by file name
``settings``  everything the numbers depend on
``notes``     sentences: deviations from the paper and where we fall short

The command adds name, seed and duration, and writes ``result.json`` and ``index.html``. `quick`
is for minutes at most, with fewer or smaller data sets; otherwise the size is the paper's.
Many independent data sets go through `datasets.run_all`: all cores, one file for each that is
finished, and an interrupted run goes on where it was. Name such an experiment in `SPREAD`, too:
the command refuses to take any other to a cluster, where nothing would be done.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from ogm_mcmc.lab.experiments import (
    adaptive,
    collisions,
    counting,
    exploration,
    gibbs_1d,
    gibbs_2d,
    joint_csail,
    joint_intel,
    joint_sim,
    leaderboard,
    localization,
    patch_hardware,
    patch_mutual_information,
    patch_sim,
    patch_toy,
    pose_particles,
    pose_sim,
    random_field,
    refined_truth,
)
from ogm_mcmc.lab.experiments.datasets import run_all
from ogm_mcmc.lab.experiments.results import make_page, row

__all__ = ['EXPERIMENTS', 'SPREAD', 'Run', 'make_page', 'row', 'run_all']


class Run(Protocol):
    """One experiment."""

    def __call__(self, folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
        """Do it; return what came out."""
        ...


EXPERIMENTS: dict[str, Run] = {
    'adaptive': adaptive.run,
    'collisions': collisions.run,
    'counting': counting.run,
    'exploration': exploration.run,
    'gibbs-1d': gibbs_1d.run,
    'gibbs-2d': gibbs_2d.run,
    'joint-csail': joint_csail.run,
    'joint-intel': joint_intel.run,
    'joint-sim': joint_sim.run,
    'leaderboard': leaderboard.run,
    'localization': localization.run,
    'patch-intel': patch_hardware.run_intel,
    'patch-mutual-information': patch_mutual_information.run,
    'patch-sim': patch_sim.run,
    'patch-stata': patch_hardware.run_stata,
    'patch-toy': patch_toy.run,
    'pose-particles': pose_particles.run,
    'pose-sim': pose_sim.run,
    'random-field': random_field.run,
    'refined-truth': refined_truth.run,
}

# Those whose work goes through `run_all`. The others take seconds, or time what they do.
SPREAD = (
    'collisions',
    'exploration',
    'gibbs-2d',
    'joint-sim',
    'leaderboard',
    'localization',
    'patch-intel',
    'patch-sim',
    'patch-stata',
    'pose-sim',
    'refined-truth',
)
