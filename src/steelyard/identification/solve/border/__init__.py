"""What a segment says about the border (body and calibration parameters) once its motion is
eliminated, summed up and solved. Imports what `identification/solve/` says of a task and a state.
"""
