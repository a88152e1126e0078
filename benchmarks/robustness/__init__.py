"""Own scenes through what displays, C-arms and operating rooms do to images, scored against the truth."""
