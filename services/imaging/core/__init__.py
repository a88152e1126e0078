"""Pure image analysis and calibration: arrays and values in, frozen results out."""
