"""The spacecraft as MJCF bodies, and the model that holds a swarm of them."""
