"""HTTP adapters: one module per REST resource."""
