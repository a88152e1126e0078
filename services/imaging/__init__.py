"""Imaging: receive the C-arm's images, find the ring, calibrate the C-arm."""
