"""What the drone's camera sees.

scene/ is what there is, planar/ and vtk/ draw it, imaging/ makes it a camera's picture.
"""
