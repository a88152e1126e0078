"""One case as a folder that somebody without this software can read and check."""
