"""How good a map is: against the truth, against another map, against beams it has not seen.

Four questions, four kinds of answers:

- Is the map right? Divergence from the truth ([gibbs] section IV), precision, recall and F1 over
  thresholds ([patch] section IV), ROC curve, distance of drawn walls to true ones.
- Are its probabilities to be believed? Reliability curve and expected calibration error; Brier
  score.
- What does it predict? Log-likelihood of held-out beams, which needs no truth at all; entropy
  and the information a scan from somewhere is expected to give.
- What is it good for? `scan_fit` weighs poses by scans with what a map offers, for localizing.

Everything takes plain arrays or a `GridMap`; unknown cells are nan, and the caller says what
they stand for. Counts and bins of several maps add up (`pooled`). `compare` computes all figures
of a map and its truth at once; `first_hits` is the one place where beams meet probabilities;
`held_out` says which beams of a recording judge a map, `held_out_points` takes points along them
for a truth, `map_frames` finds where a map lies that has another frame than they.
"""

from ogm_mcmc.evaluation.beam_likelihood import (
    LogDensity,
    beam_log_likelihood,
    log_likelihood_of_samples,
)
from ogm_mcmc.evaluation.calibration import Reliability, brier_score, reliability
from ogm_mcmc.evaluation.classification import Scores, ThresholdCounts, confusion_counts
from ogm_mcmc.evaluation.comparison import Comparison, aligned, compare
from ogm_mcmc.evaluation.distance import DistanceError, distance_to, occupied_distance_error
from ogm_mcmc.evaluation.divergence import (
    Divergence,
    divergence,
    entropy_nats,
    total_divergence,
)
from ogm_mcmc.evaluation.first_hits import FirstHits, first_hits
from ogm_mcmc.evaluation.held_out import (
    LEAVING,
    HeldOutBeams,
    Ratio,
    held_out_beams,
    ratio_of_sums,
    seen_from,
    without_beams_that_leave,
)
from ogm_mcmc.evaluation.held_out_points import (
    HeldOutPoints,
    PointScores,
    held_out_points,
    probability_at,
    score_points,
)
from ogm_mcmc.evaluation.information import expected_information_gain
from ogm_mcmc.evaluation.map_frames import FoundFrame, FrameSearch, find_frame, gain_near_by
from ogm_mcmc.evaluation.masks import MASKS, cells_that_count, near
from ogm_mcmc.evaluation.scan_fit import AmclNumbers, CastBeams, LikelihoodField, SampleBeams
from ogm_mcmc.evaluation.views import ReadingChannel, hits_of_map, hits_of_samples
from ogm_mcmc.sensors import ForwardModel

__all__ = [
    'LEAVING',
    'MASKS',
    'AmclNumbers',
    'CastBeams',
    'Comparison',
    'DistanceError',
    'Divergence',
    'FirstHits',
    'ForwardModel',
    'FoundFrame',
    'FrameSearch',
    'HeldOutBeams',
    'HeldOutPoints',
    'LikelihoodField',
    'LogDensity',
    'PointScores',
    'Ratio',
    'ReadingChannel',
    'Reliability',
    'SampleBeams',
    'Scores',
    'ThresholdCounts',
    'aligned',
    'beam_log_likelihood',
    'brier_score',
    'cells_that_count',
    'compare',
    'confusion_counts',
    'distance_to',
    'divergence',
    'entropy_nats',
    'expected_information_gain',
    'find_frame',
    'first_hits',
    'gain_near_by',
    'held_out_beams',
    'held_out_points',
    'hits_of_map',
    'hits_of_samples',
    'log_likelihood_of_samples',
    'near',
    'occupied_distance_error',
    'probability_at',
    'ratio_of_sums',
    'reliability',
    'score_points',
    'seen_from',
    'total_divergence',
    'without_beams_that_leave',
]
