"""Figures printed in the thesis: results, gains and tolerances."""
