"""How the robot's head holds the guide, measured from images in several poses (`distalock robot calibrate-guide`)."""
