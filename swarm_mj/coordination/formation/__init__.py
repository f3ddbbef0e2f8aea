"""Movement of a swarm: where each has to be, the force law that keeps it there, and the proof that none comes too close."""
