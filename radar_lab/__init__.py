"""What studies need and live use does not: the whole pipeline offline, evaluation, calibration, data sets, training. No ROS."""
