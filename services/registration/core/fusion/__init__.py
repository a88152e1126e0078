"""Several images of one set-up: their joint estimate, and whether they agree."""
