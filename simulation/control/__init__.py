"""The HTTP interface that tests and demonstrations control the room with."""
