"""Faults of a whole installation, each at every step of the procedure: `distalock bench faults`, `make faults`."""
