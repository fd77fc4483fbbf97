"""What the live page shows (cell.py, trace.py) and how (page.py and the rest, on viser); ROS stays in dashboard.py."""
