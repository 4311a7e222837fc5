"""What the drone measures: pictures, its motion and its own state.

Camera draws with rendering/; Imu shows angular velocity and specific force as a real one would;
StateEstimate adds the noise of the original system.
"""
