"""Mathematics that knows nothing of drones: vectors, quaternions, small matrices, random numbers.

It imports nothing of airrace but common/.
"""
