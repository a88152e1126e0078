"""Adapters to the hexapod controller."""
