"""Nodes of tracking."""
