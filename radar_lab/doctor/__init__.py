"""What is wrong with what a radar gives, and what to change: measurements of `handwave doctor`, on frames, clouds, tracks and stamps."""
