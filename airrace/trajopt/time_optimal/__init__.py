"""Time-optimal laps and transitions within what the rotors can do.

optimal_lap.py and optimal_transition.py plan them; lap_search.py states the method.
"""
