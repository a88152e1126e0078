"""Whether the guide is held as the case says: by where it is, and by how it moved."""
