"""DCA1000EVM capture boards behind TI's xWR sensors: raw samples over UDP, the sensor's CLI over a serial port."""
