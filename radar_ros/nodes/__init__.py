"""Nodes that belong to no stage: visualisation, evaluation, recorder."""
