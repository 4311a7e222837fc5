"""Hardware in the loop: the autonomy in another process, or on another computer.

link/ carries messages over LCM; companion/ starts the autonomy where it shall run.
"""
