"""Reading for `handwave doctor`: bags, and a running graph."""
