"""Who images what, when: the problem, its optimum with proof, greedy choice, and an auction by messages."""
