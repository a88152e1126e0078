"""Kinematics, motion, faults and stop latency of the robot service."""
