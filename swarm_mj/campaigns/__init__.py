"""Campaigns: many flights with drawn parameters, their results, and what they say in sum."""
