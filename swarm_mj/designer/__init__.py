"""The automated swarm designer: who visits which point, found by evolution and by proof (AAS 19-144, equations 1 to 6)."""
