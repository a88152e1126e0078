"""Places of the balls of a built ring or guide, estimated from several images of it."""
