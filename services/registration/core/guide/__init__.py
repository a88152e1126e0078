"""The drill guide: its balls named and measured, and its pose."""
