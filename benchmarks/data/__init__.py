"""Images that are read from folders, with their manifest and truth."""
