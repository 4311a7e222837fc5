"""The true drone and its world: body, rotors, drag, wind, gates that move.

The autonomy knows none of it.
"""
