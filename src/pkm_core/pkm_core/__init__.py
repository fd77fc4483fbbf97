"""The mathematics of the parallel-manipulator cell; a plain Python library that knows nothing of ROS."""
