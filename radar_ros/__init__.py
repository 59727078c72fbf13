"""The plumbing that every node shares, and the handwave command."""
