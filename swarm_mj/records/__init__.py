"""What a run leaves behind: its files, their readers, its summary and what a reader should know of it."""
