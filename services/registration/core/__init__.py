"""Pure estimation and acceptance: arrays and values in, frozen results out."""
