"""SwarmObserve-v1: episodes over many missions, each drawn anew. `single`, `vector` and `multi_agent` are its environments."""
