"""Records the examples of the OpenAPI document: one procedure in the virtual operating room, every answer kept once."""
