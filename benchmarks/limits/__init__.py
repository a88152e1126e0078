"""The smallest errors that any unbiased method can have."""
