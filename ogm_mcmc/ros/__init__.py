"""The ROS 2 rim: nodes, parameters, QoS.

Nothing else imports ROS.

The nodes stay thin: what they do with a message is in `ogm_mcmc.pipeline`, `ogm_mcmc.engine`
and `ogm_mcmc.io.messages`, which know no ROS. Everything optional (tf2_msgs, map_msgs) is
imported where it is used, and every node runs without it.

`refine_server` samples for minutes and still answers at once. Decision: one worker thread beside
the one that handles messages, no executor with several threads. Kernels release the GIL, orders
and results are single references that are swapped, and an order takes effect after a round of
0.1 s. The worker has a lower priority than everything else on the machine (`niceness`), so that
the live map never waits for the refined one. Files of chains are written by the worker. Signals
are noted rather than left to rclpy, which would end ROS before the last map could be published.
"""
