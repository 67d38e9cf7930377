"""Sensor models: what a reading says about cells.

`forward_model` gives p(range | first occupied cell), which the full posterior needs ([gibbs]
section III; the mixture is the field's standard one).
"""
