"""SwarmObserve: a flyby of a scenario of one's own, for one flight, many, and many agents; SwarmMap is one of its kinds."""
