"""Files of other programs: a flight as CCSDS messages, SPICE kernels, STK, Vizard, Cosmographia, glTF and CSV, and OEM back.

Frame N of swarm_mj is written as SPICE's ECLIPJ2000; messages and STK files are in EME2000. Times are TDB.
"""
