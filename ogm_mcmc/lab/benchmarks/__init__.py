"""Speed, measured on purpose: `ogm_mcmc bench`; never in a timed test.

Design note. Wall-clock figures of one run on one noisy machine mean little, so each case repeats
the whole input several times on a map that was emptied and reports the best and the median;
compare ratios of figures taken in one run. Only the mapping call is timed
(`MappingMethod.update`, from ranges and pose to the changed grid); reading, placing and drawing
are not.
"""
