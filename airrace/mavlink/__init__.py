"""The interface of the AI Grand Prix: what its clients send and hear, on MAVLink and a picture
stream.

What is on the wire and since when it is known: docs/grand_prix.md.
"""
