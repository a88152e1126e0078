"""PI GCS 2.0."""
