"""What goes wrong in flight or is not as planned: schedule, dispersions, sensors with an attitude filter, wheels, impact."""
