"""Feedback control: the model of an axis, robust and computed-torque control, stability margins."""
