"""What maintainers run: the measured pages of docs/ and what builds the site."""
