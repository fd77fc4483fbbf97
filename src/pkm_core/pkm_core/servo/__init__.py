"""State machines of the servo tick and of a motion cycle, without ROS, clocks or I/O."""
