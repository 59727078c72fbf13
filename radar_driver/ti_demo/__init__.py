"""TI radars whose demo software sends point clouds over a serial port: packets, ports, clouds."""
