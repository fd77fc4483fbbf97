"""The closed loop without ROS: cycles and experiments on the simulated machine."""
