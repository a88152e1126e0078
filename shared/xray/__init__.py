"""Measurements in X-ray images that more than one service makes: balls and their centres."""
