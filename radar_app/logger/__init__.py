"""The data logger: detected gestures with their labels, on disk before anybody is told that they are (thesis, section 4.4)."""
