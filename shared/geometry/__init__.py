"""Frames, transforms, lines, cameras and kinematics. Pure: arrays and frozen values, millimetres, right-handed."""
