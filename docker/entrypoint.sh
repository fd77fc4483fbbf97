#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command in the environment of the ROS installation and of the cell.
set -e
source /opt/ros/jazzy/setup.bash
source /cell/install/setup.bash
export PATH=/cell/install/lib/pkm_core:$PATH
exec "$@"
