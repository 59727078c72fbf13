"""What accuracy costs in time: every knob that buys one with the other, measured in one run (`handwave tradeoff`)."""
