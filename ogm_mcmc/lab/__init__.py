"""Experiments, benchmarks, exact posteriors, work on clusters: the product never imports this."""
