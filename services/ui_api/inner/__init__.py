"""HTTP as the application hears it from its front: requests that were read and checked there, one parser for both."""
