"""Clouds of several radars as one."""
