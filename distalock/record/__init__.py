"""`distalock record`: keep, hand over and thin out what the gateway wrote down."""
