"""REST gateway, procedure and case record."""
