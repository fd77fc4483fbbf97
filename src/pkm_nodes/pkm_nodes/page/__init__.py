"""The live page: its data (cell.py, trace.py) and its drawing on viser (page.py and the other files); no ROS calls."""
