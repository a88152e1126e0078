"""Running fluoroscopy: the nail followed from frame to frame, and how to turn the C-arm."""
