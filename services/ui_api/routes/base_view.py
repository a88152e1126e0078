"""The base of all answers."""

from pydantic import BaseModel


class View(BaseModel):
    """Base of all answers."""
