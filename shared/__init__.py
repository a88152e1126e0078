"""What the services have in common: errors, geometry, X-ray measurements, parts, messages, bus, runtime."""
