"""A scenario flown: planned (`plan`), simulated (`fly`), observed (`observe`)."""
