#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Gives every command the ROS installation and the cell built on it.
set -e
source /opt/ros/jazzy/setup.bash
source /cell/install/setup.bash
export PATH=/cell/install/lib/pkm_core:$PATH
exec "$@"
