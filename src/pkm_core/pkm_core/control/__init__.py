"""Feedback control: what a controller may know, the robust and the computed-torque law, their margins and tuning."""
