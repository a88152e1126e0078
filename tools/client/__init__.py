"""Generates the modules of `distalock.client` that follow from `openapi.json` and `asyncapi.json`."""
