"""The quickest laps within what the rotors can do.

optimal_lap.py is where to start; it improves a lap by one convex program after another.
"""
