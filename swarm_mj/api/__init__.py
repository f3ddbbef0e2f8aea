"""What `import swarm_mj` offers: scenarios, flights, designs and campaigns as objects; `swarm_mj` imports it name by name.

The command line is a thin layer over this room and the library; what needs Python, as steps by hand or the axes of a figure, is
here alone.
"""
