"""K-wires: found in one image or several, and their axes against the nail's holes."""
