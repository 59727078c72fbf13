"""Point clouds to people."""
