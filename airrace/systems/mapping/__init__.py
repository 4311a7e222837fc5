"""From detections to the map of the gates.

GateMapper holds the map; gate_estimator.py and marker_statistics.py are the two estimators.
"""
