"""What is looked at between the fits of motion and forces: knots, readings that stand out, and the
tensions by which cables stretch.
"""
