"""From encoder counts to joint angles: CAN, replay and simulation behind one protocol; no ROS."""
