"""Infineon's BGT60TR13C through the maker's own library, where that is installed."""
