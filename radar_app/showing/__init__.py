"""What is in a bag: gestures and tracks as tables, pictures and films."""
