"""Versioned messages: what services say to one another on the bus, as frozen pydantic models with committed schemas."""
