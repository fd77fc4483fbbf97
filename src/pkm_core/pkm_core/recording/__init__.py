"""What the recorder of a cell does with its messages: sort them into cycles and write one bag of each; ROS-free."""
