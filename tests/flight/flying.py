"""A plan that was flown and recorded, flown again in a live view."""

from swarm_mj.rendering.live import LiveFlight


def fly_live(plan):
    """A live view at its end."""
    live = LiveFlight(plan)
    while not live.over:
        live.step()
    live.close()
    return live
