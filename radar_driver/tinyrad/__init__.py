"""The EV-TINYRAD24G: 24 GHz, two transmitters, four receivers with real samples, over USB."""
