"""Tracked points to gestures: motion samples, events, features, classifier; data sets and training."""
