"""Where the drone is, from nothing but its inertial sensor, its rotors and its camera.

Two systems share the work. StrapdownIntegrator carries pose and velocity forward with every
sample of the gyroscope and the accelerometer; GateSlam corrects them at every picture, and
maps the gates. Their mathematics is an error-state Kalman filter whose landmarks are the gates
(J. Sola, "Quaternion kinematics for the error-state Kalman filter", 2017; simultaneous
localization and mapping, SLAM, as in Thrun, Burgard and Fox, "Probabilistic Robotics", 2005,
chapter 10):

- navigation.py: the nominal state, and how samples move it;
- alignment.py: attitude and biases of a drone at rest on its pad;
- error_state.py: the error of that state, and how its covariance grows;
- gate_projection.py: where the corners of a marker should appear;
- kalman_update.py: what a picture of them tells;
- landmarks.py: gates, and how a new one enters the filter;
- slam_state.py: what is known after a picture, and the map for explorer and planner;
- slam_filter.py: all of it, one picture after the other.
"""
