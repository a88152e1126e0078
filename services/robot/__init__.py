"""Robot: the hexapod's driver and the last authority on its motion."""
