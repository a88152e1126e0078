"""Pure motion logic: the motion table, the guard and paths."""
