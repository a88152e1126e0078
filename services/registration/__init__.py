"""Registration: find guide, nail and wires in a calibrated image, judge the result, plan the move."""
