"""The virtual operating room: stands where the hospital's hardware stands and speaks its protocols."""
