"""Scores against truth, and their reports."""
