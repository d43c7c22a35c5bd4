"""ROS messages to core values and back, for rclpy and rosbags objects alike."""
