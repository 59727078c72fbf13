"""What a person starts: the handwave command, the graph of nodes, the demo, previews."""
