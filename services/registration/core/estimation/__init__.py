"""Poses and their errors: estimated from image points, transported, conditioned and fused."""
