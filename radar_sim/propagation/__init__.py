"""Echoes to samples: models of propagation from fast to exact, behind one protocol (`radar_sim.propagation.base`)."""
