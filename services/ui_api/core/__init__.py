"""Pure parts of the gateway: events, their hash chain, what a case is, and which action may come next."""
