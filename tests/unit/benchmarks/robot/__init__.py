"""Benchmarks of the robot."""
