"""How the drone finds the gates of an unknown track.

Explorer is a state machine: explorer_states.py has its states and transitions, search.py the
steps of a search, explorer_legs.py and clear_paths.py the flights in between.
"""
