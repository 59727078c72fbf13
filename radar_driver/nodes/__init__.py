"""Nodes of the driver besides the driver itself."""
