"""A running graph, seen from outside: who is there, which gestures, how the nodes are doing."""
