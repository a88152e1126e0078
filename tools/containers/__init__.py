"""Builds, starts and tries an installation of containers: `make containers`."""
