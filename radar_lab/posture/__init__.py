"""Both hands from one cloud: a study (MARS); no node publishes it."""
