"""Acceptance criteria of images, sets of images, frames of fluoroscopy, wires and plans, and their rules."""
