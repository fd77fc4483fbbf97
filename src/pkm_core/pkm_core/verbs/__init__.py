"""The verbs of `pkm` that need no ROS: options in, one call of the core, a table, figures and JSON out."""
