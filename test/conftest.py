"""Tests use ROS domains of their own, this machine only, and check every message field."""

import os

# Before anything imports rclpy or messages. The process id keeps parallel workers and parallel runs of the suite apart. Domains above
# 101 have ports that the system also gives to anybody who asks for any port.
os.environ["ROS_DOMAIN_ID"] = str(10 + os.getpid() % 40)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
for _pool in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_pool}_NUM_THREADS", "1")
