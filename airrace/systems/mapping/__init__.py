"""From detections to the map of the gates.

GateMapper is the system and image_mapper.py what it computes, with one of two estimators:
robust_estimator.py (which also notices that a gate has moved) or original_estimator.py.
"""
