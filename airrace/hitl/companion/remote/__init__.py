"""What runs on the companion computer before airrace does, or beside it.

It is brought there and run by whatever Python 3.12 to 3.14 is found: nothing
here imports anything but the standard library and its own modules.
"""
