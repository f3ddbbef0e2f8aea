"""Environment steps per second, side by side with bsk_rl's examples with five satellites."""
