"""How good recognition is: scores against the truth, statistics, reports and pictures."""
