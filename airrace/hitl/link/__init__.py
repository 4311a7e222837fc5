"""HITL's link between simulation and autonomy: messages, checks, clocks, the doctor."""
