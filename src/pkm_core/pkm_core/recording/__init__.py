"""Sorts the messages of a cell into cycles and writes one bag per cycle; ROS-free."""
