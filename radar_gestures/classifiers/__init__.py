"""Classifiers: training, calibration, rejection, validation, and the model files that recognisers read."""
