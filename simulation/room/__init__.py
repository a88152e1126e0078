"""The operating room while a case goes on: what people do in it, and what that does."""
