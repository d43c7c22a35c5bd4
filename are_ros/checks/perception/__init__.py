"""What the robot perceives, compared with what is there."""
