"""A stack process that speaks the door on one side and ROS 2's topics over DDS on the other."""
