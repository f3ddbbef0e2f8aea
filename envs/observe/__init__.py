"""SwarmObserve-v0: flybys drawn from a catalogue, or one of a user's own, for one episode, many, and many agents."""
