"""What a swarm does together: who hears whom, what each one knows, who images what, and what becomes of it after a loss."""
