"""The `distalock` command and the small Python API: the only place that sees several services at once."""
