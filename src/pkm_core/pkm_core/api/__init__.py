"""
The public face of pkm_core: what ``import pkm_core as pkm`` offers to a script or a notebook, without ROS.

Names are listed in `pkm_core.__all__` and loaded at first use. Lengths are in metres, times in seconds, voltages in
volts and frequencies in hertz; arrays have one row per sample and one column per joint.
"""
