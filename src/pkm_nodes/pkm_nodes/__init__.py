"""The rclpy nodes of the parallel-manipulator cell: thin shells on pkm_core."""
