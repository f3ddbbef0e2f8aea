"""What `import swarm_mj` offers: scenarios, flights, designs and campaigns as objects; `swarm_mj` imports it name by name.

The command line is a thin layer over this room: nothing can be done there that cannot be done here, and the other way round.
"""
