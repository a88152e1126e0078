"""Tests of part calibration."""
