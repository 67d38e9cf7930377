"""Experiments, benchmarks and work on clusters: the product never imports this."""
