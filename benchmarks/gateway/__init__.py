"""The gateway beside what it is compared with, and under many hands at once."""
