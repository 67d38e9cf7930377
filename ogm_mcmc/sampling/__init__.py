"""Sampling maps from the full posterior ([gibbs], [patch])."""
