"""Between ROS 2 and steelyard watch."""
