"""Acconeer's A121 over its exploration server: pulses, one channel, IQ values at chosen distances."""
