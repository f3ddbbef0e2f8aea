"""Files of other programs: a flight as CCSDS messages, SPICE kernels, glTF and CSV, and OEM back.

Frame N of swarm_mj is written as SPICE's ECLIPJ2000; messages are in EME2000. Times are TDB.
"""
