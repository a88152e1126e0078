"""Many rooms at one site: whether a room notices the others, and what each costs."""
