"""Occupancy grid mapping with probabilities that can be believed.

Capability table
----------------
========================  =================================  ==============================
what                      where                              source
========================  =================================  ==============================
live map, known pose      `ogm_mcmc.mapping.two_assumption`  [gibbs] section II, [slides]
live map, uncertain pose  `ogm_mcmc.mapping.pose_uncertain`  [pose] section V
adaptive resolution       `ogm_mcmc.mapping.adaptive`        [pose] section VI
predicted cells           `ogm_mcmc.mapping.random_field`    [field]
reflection probabilities  `ogm_mcmc.mapping.counting`        [slides]
maps from sonars          `ogm_mcmc.mapping.sonar`           [slides]
inverse sensor models     `ogm_mcmc.sensors.inverse_model`   [pose] Eq. 4, [slides]
full posterior, sampled   `ogm_mcmc.sampling`                [gibbs] section III, [patch]
full posterior, exactly   `ogm_mcmc.lab.exact`               [gibbs] section II
poses refined together    `ogm_mcmc.trajectory`              none, see its design note
exact ray traversal       `ogm_mcmc.geometry`                none, see its design note
full posterior, live      `ogm_mcmc.ros.refine_server`       node `refine_server`
learned patch priors      `ogm_mcmc.sampling.patch_prior`    [patch] section III
scans to maps             `ogm_mcmc.engine`                  none
divergence, scores, ...   `ogm_mcmc.evaluation`              [gibbs] and [patch] section IV
published results         `ogm_mcmc.lab.experiments`         the papers
work on a Dask cluster    `ogm_mcmc.lab.cluster`             extra `cluster`
pages, curves, pictures   `ogm_mcmc.plotting`                extra `plots`
CARMEN logs, bags, maps   `ogm_mcmc.io`                      file formats
files as such, guarded    `ogm_mcmc.files`                   none
simulated buildings       `ogm_mcmc.simulation`              [gibbs] section IV-B
ROS 2 nodes               `ogm_mcmc.ros`                     needs rclpy
========================  =================================  ==============================

A newcomer reads `ogm_mcmc.pipeline` first: scan + pose -> rays -> grid -> message on one page.

Keys of the sources, cited all over the package: [gibbs] Merali and Barfoot, "Occupancy grid
mapping with Markov chain Monte Carlo Gibbs sampling", ICRA 2013; [patch] the same authors,
patch-based sampling with a data-driven prior; [pose] Joubert, Brink and Herbst, pose-uncertain
occupancy grid mapping by Monte Carlo integration; [slides] Burgard and Krawez, "Grid maps and
mapping with known poses"; [field] GRF-LOOM, log-odds Gaussian random fields.
"""

__version__ = '0.1.0'
