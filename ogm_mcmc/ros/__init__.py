"""The ROS 2 rim: nodes, parameters, QoS.

Nothing else imports ROS, but for `ogm_mcmc.testing.ros`, which tests it.

The nodes stay thin: what they do with a message is in `ogm_mcmc.pipeline`, `ogm_mcmc.placement`
and `ogm_mcmc.io.messages`, which know no ROS. Everything optional (tf2_ros, map_msgs) is
imported where it is used, and every node runs without it.
"""
