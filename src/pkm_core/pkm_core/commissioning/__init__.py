"""
Commissioning of an unknown machine, without ROS: identify, tune, check, accept, calibrate, learn; `pkm commission`.

Identification itself is in the package identification. Only `ConfigCopy` touches the truth of the simulated machine: it
draws a random one from a `truth_seed`.
"""
