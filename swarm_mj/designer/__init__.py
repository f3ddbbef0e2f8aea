"""The automated swarm designer: who visits which point, found by evolution and by proof.

Everything here works on a boolean matrix `sees` (points x faces) and the areas of the faces (AAS 19-144, equations 1 to
6) and knows no scenario, no trajectory and no simulator.
"""
