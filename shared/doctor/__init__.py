"""Findings on a machine and its installation: what was measured, and what to do. Changes nothing."""
