"""Hi-Link LD2450: three targets over a serial port."""
