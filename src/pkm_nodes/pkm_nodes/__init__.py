"""The rclpy nodes of the cell: thin shells on pkm_core."""

import os
from pathlib import Path

# read by Fast DDS when the first participant of this process is made
os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', str(Path(__file__).with_name('fastdds.xml')))
