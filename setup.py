"""For ROS tools that look for a setup.py; pip builds with scikit-build-core (pyproject.toml), colcon with CMakeLists.txt."""

from setuptools import find_packages, setup

setup(packages=find_packages(include=["radar_*", "radar_*.*", "benchmarks", "benchmarks.*"]))
