"""The message bus: one port, a Zenoh and an in-memory implementation, and the router."""
