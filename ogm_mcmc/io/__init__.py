"""Bags, logs, messages and map files: everything that enters or leaves; no ROS needed.

What comes from outside is checked here, at the door, and turned into the types of
`ogm_mcmc.geometry`; what is wrong raises an `OgmError` that names the file or message, the
field, the value and what was expected. Whatever is written goes to a temporary name first and
takes its place when complete.
"""
