"""Adapters to image sources."""
