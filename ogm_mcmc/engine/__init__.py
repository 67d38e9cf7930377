"""What nodes, commands and experiments share between a placed scan and a finished map.

    scans + poses --placing, bag_scans--> PlacedScan --+--> live_map.map_of -----> GridMap
                                                       +--> pipeline, map_view --> live display
                                                       +--> recording -> refinement (posterior)
                                                                         worker: in a thread

`placing` waits for poses and never misplaces a scan; `bag_scans` reads a recording the same way;
poses come from a history, from a tree of transforms (`transform_tree`, `tf_poses`) or from the
source that `pose_choice` finds to cover the scans best; `range_codes` knows what a driver sends
for "nothing was hit", `no_returns` what that means; `sensor_fit` and `range_spread` find how a
sensor errs, `scan_rhythm` scans that never came; `deskew` bends scans taken on the move;
`recording` keeps what is to be sampled; `posterior` turns settings into a model of the sampler;
`refinement` samples for as long as there is time; `worker` does so while its node goes on;
`recorded_map` maps a bag; `prior_learning` counts patches of maps; what is made here is kept in
files by `saved_map`, `saved_chains`, `tree_files` and `prior_files`; `warm_up` compiles kernels,
which `compiling` makes quicker; `signals` are all ways in which they take Ctrl-C and SIGTERM. No
module here imports ROS.
"""
