"""Parts of nodes: each belongs to one subject and is owned by a node."""
