"""Application services: each handler does one job of the gateway (cases, planning, commands, stop), without HTTP."""
