"""The default renderer: boards, pylons and lawn drawn as polygons, without a graphics library.

renderer.py is where to start; polygons are collected, sorted and painted.
"""
