"""Containers: their sizes, their first image, the way of their frames, and what they survive."""
