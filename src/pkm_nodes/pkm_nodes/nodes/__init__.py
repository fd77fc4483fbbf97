"""The executables of `ros2 run`, one node per file."""
