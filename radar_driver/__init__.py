"""Devices to raw frames: simulated radar and recordings; the driver node."""
