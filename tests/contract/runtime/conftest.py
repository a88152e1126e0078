"""Rooms on both implementations of the bus."""

from tests.contract.bus.conftest import room, shared_router

__all__ = ["room", "shared_router"]
