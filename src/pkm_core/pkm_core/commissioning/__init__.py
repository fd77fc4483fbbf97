"""
From an unknown machine to a learned motion: what the nodes and `pkm commission` do, without ROS.

plan.py says which experiments identify an axis, excited_axis.py is what its controller does meanwhile, and fits.py
makes models of the bags. Nothing here reads the truth of the simulated machine.
"""
