"""Acceptance of images, sets of images, frames of fluoroscopy, wires and plans: criteria and rules."""
