"""What every command and node does with scans and poses, free of ROS: it is told, and answers.

Poses come from a tree of transforms (`transform_tree`, `tf_poses`) or from the source that
`pose_choice` finds to cover the scans best; `deskew` cuts scans that were taken on the move.
"""
