"""Where everything in the room is: poses at one moment."""
