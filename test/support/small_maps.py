"""A map of twelve cells and its truth, made by hand."""

import numpy as np

__all__ = ['ESTIMATE', 'NAN', 'TRUTH']

NAN = np.nan

TRUTH = np.array([[0, 0, 1, 1], [0, 0, 0, 1], [1, 0, 0, NAN]], np.float32)

ESTIMATE = np.array([[0.1, 0.2, 0.9, NAN], [0.1, 0.6, 0.3, 0.8], [0.4, 0.1, 0.2, 0.5]], np.float32)
