"""What goes wrong in flight or is not as planned: the schedule of faults, dispersions, injection, who succeeds a lost relay."""
