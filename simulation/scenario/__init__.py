"""Seeded scenarios of the virtual operating room: values, file form and sampling."""
