"""What the drone measures: pictures and its own state.

Camera draws with rendering/; StateEstimate adds the noise of the reference system.
"""
