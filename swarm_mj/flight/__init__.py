"""A scenario flown: planned (`plan`), simulated (`fly`), observed (`observe`), its pictures sent to Earth (`downlink`)."""
