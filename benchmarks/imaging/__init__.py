"""Ball detection, calibration and identification of the ring, against peers and limits."""
