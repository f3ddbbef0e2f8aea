"""The way of the data: radios, link budgets, contacts, storage, and what reaches Earth when."""
