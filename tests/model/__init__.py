"""Model check: every order of events in which robot service and gateway can meet, searched over the code that runs."""
