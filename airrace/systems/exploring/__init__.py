"""How the drone finds gates that nobody has told it of.

Explorer is a state machine: its states are in explorer_states.py, its flights in explorer_legs.py.
"""
