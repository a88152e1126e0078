"""What the routes call: each desk does one job of the gateway (cases, planning, commands, stop) and knows no HTTP."""
