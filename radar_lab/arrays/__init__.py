"""Calibration of an antenna array from turntable measurements, and its ambiguity function."""
