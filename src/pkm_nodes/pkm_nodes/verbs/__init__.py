"""The verbs of `pkm` that need ROS, one per file."""
