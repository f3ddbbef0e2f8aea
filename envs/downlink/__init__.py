"""SwarmDownlink-v0: who talks to whom after the encounter."""
