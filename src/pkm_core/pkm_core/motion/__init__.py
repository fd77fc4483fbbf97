"""Motions: profiles, paths, planning and the metrics of a move."""
