"""`distalock doctor`: what of this machine and of an installation would keep a procedure from going well."""
