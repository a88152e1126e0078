"""Global search for the nail in an image: band, holes, outlines, initial pose."""
