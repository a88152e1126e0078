"""The four services. They meet only on the bus and never import one another."""
