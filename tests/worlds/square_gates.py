"""Square gates anywhere, for hypothesis."""

from hypothesis import strategies as st

from airrace.track.square_gate import SquareGate

square_gates = st.builds(
    SquareGate,
    position=st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3),
    yaw_deg=st.floats(-360.0, 360.0),
    pitch_deg=st.floats(-60.0, 60.0),
)
