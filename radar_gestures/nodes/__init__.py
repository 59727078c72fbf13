"""Nodes of gesture evaluation."""
