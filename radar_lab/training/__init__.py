"""Training, calibration and validation of gesture models."""
