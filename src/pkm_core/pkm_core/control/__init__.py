"""Feedback control of one axis: what a controller may know, its filters, the robust law and its margins."""
