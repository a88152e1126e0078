"""The console in a real browser: a person at the page, and how fast and how accessible the page is."""
