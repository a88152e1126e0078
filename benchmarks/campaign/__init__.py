"""A thousand procedures in the virtual room, with what goes wrong: every harm is a bug with a seed."""
