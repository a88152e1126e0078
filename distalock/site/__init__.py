"""`distalock site`: many rooms, and a control desk that sees all and commands none."""
