"""Files, folders, locks, caches, progress and interruption: what the other rooms stand on; nothing of the physics."""
