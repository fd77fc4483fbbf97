"""Clients of a running cell, and the processes of a cell."""
