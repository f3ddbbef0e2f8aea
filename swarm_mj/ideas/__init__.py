"""From a requirement to a swarm: the spacecraft that it needs, the swarm, the flight, and what was studied before."""
